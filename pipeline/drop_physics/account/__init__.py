"""The account lists what was requested, what resulted, and which impulses explain the gap."""
