"""The verbs: functions from paths to a typed result."""
