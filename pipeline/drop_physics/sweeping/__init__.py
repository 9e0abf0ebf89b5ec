"""Many scenarios: which they are, who runs them, and where their rows are kept."""
