"""The paper's parameter studies: every row of its tables measured here, beside the paper's own numbers."""
