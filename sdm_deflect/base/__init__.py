"""The base of all packages: arrays, compiled code, threads, files, settings, errors."""
