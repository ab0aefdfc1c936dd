"""The method on the fighter's left tail: one figure, and the numbers that texts quote."""
