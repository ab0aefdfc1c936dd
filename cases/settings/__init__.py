"""Settings of users, and their conversion to jobs."""
