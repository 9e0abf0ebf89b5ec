"""The account: what was asked of each body, what came, and which terms of the sum took it."""
