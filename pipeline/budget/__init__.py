"""The judge: takes a recorded fall apart. It knows neither the engine nor the recorder."""
