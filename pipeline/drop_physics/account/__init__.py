"""The account: requests to each body, their outcome, and the terms of the sum that explain it."""
