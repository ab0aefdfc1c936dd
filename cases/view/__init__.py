"""`sdm view`: a finished run in the browser, with a slider for the angle."""
