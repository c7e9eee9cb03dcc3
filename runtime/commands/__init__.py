"""How commands are read: files and documents of many kinds, resampling to 1 kHz, and paths without time."""
