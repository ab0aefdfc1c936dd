"""Settings: what users write becomes a job."""
