"""The page and the pictures of one run."""
