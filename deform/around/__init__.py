"""What the product adds to the paper's method, a file for each addition."""
