"""The rules, one file per question: each looks for one reason why a simulation went wrong."""
