"""The laws of engines: what each adds to a step, reports of it, or steps otherwise."""
