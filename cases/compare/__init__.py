"""Finished runs beside each other: their figures and settings in tables, their pictures over each other."""
