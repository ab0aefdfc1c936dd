"""What all rooms of the engine stand on: compiled code, threads, errors, progress."""
