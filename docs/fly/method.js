// The method: s(p) = a0 + a . p + sum of b_j phi(|p - c_j|) with phi(r) = r^2 ln r, in coordinates scaled to [-1, 1].
// Points are rows of three numbers, and values rows of `columns` numbers, one row after another.
const kernel = (squared) => (squared > 0 ? 0.5 * squared * Math.log(squared) : 0);

// The map of points into [-1, 1]: one scale for all directions.
function scaling(points) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  points.forEach((value, i) => { low[i % 3] = Math.min(low[i % 3], value); high[i % 3] = Math.max(high[i % 3], value); });
  const middle = low.map((value, c) => (value + high[c]) / 2), half = Math.max(...low.map((value, c) => high[c] - value)) / 2;
  return (some) => Float64Array.from(some, (value, i) => (value - middle[i % 3]) / half);
}

// Solve a system (n, n) for right sides (n, columns) by elimination with row pivots; both arrays are changed.
function solved(matrix, right, n, columns) {
  const swap = (array, width, i, j) => {
    for (let k = 0; k < width; k += 1) [array[i * width + k], array[j * width + k]] = [array[j * width + k], array[i * width + k]];
  };
  for (let k = 0; k < n; k += 1) {
    let pivot = k;
    for (let i = k + 1; i < n; i += 1) if (Math.abs(matrix[i * n + k]) > Math.abs(matrix[pivot * n + k])) pivot = i;
    if (pivot !== k) { swap(matrix, n, pivot, k); swap(right, columns, pivot, k); }
    for (let i = k + 1; i < n; i += 1) {
      const factor = matrix[i * n + k] / matrix[k * n + k];
      if (factor === 0) continue;
      for (let j = k + 1; j < n; j += 1) matrix[i * n + j] -= factor * matrix[k * n + j];
      for (let j = 0; j < columns; j += 1) right[i * columns + j] -= factor * right[k * columns + j];
    }
  }
  for (let i = n - 1; i >= 0; i -= 1) {
    for (let j = 0; j < columns; j += 1) {
      let value = right[i * columns + j];
      for (let k = i + 1; k < n; k += 1) value -= matrix[i * n + k] * right[k * columns + j];
      right[i * columns + j] = value / matrix[i * n + i];
    }
  }
  return right;
}

class Interpolant {
  // Interpolate values at the points of some rows, the centres; `scaled` maps points into [-1, 1].
  constructor(points, values, columns, centres, scaled) {
    const n = centres.length + 4, all = scaled(points), matrix = new Float64Array(n * n), right = new Float64Array(n * columns);
    this.columns = columns;
    this.scaled = scaled;
    this.places = Float64Array.from(centres.flatMap((row) => Array.from(all.subarray(3 * row, 3 * row + 3))));
    centres.forEach((row, i) => {
      [1, ...this.places.subarray(3 * i, 3 * i + 3)].forEach((value, k) => {
        matrix[(i + 4) * n + k] = matrix[k * n + i + 4] = value;
      });
      for (let j = 0; j < i; j += 1) matrix[(i + 4) * n + j + 4] = matrix[(j + 4) * n + i + 4] = kernel(this.squared(this.places, i, j));
      for (let c = 0; c < columns; c += 1) right[(i + 4) * columns + c] = values[row * columns + c];
    });
    this.weights = solved(matrix, right, n, columns);
  }

  // Squared distance of a scaled point from a centre.
  squared(points, i, j) {
    const x = points[3 * i] - this.places[3 * j], y = points[3 * i + 1] - this.places[3 * j + 1], z = points[3 * i + 2] - this.places[3 * j + 2];
    return x * x + y * y + z * z;
  }

  // Values (M, columns) at points (M, 3): those of the linear part, if `linear`, and of the first `most` centres.
  at(points, most = this.places.length / 3, linear = true) {
    const { columns, weights } = this, all = this.scaled(points), count = all.length / 3, out = new Float64Array(count * columns);
    for (let i = 0; i < count; i += 1) {
      for (let c = 0; linear && c < columns; c += 1) {
        out[i * columns + c] = weights[c] + weights[columns + c] * all[3 * i] + weights[2 * columns + c] * all[3 * i + 1]
          + weights[3 * columns + c] * all[3 * i + 2];
      }
      for (let j = 0; j < most; j += 1) {
        const value = kernel(this.squared(all, i, j)), row = (j + 4) * columns;
        for (let c = 0; c < columns; c += 1) out[i * columns + c] += value * weights[row + c];
      }
    }
    return out;
  }
}

// The site with the largest error that is no centre.
function worst(errors, centres) {
  const taken = new Set(centres);
  let found = -1;
  errors.forEach((error, i) => { if (!taken.has(i) && (found < 0 || error > errors[found])) found = i; });
  return found;
}
