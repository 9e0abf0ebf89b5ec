"""Many scenarios: their plan, their runs, and the table of their rows."""
