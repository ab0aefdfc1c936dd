// The left tail alone, by the steps of `deform/confined.py`: its sites, and the fields by which the mesh may move.
// Values have a column for each function of the angle and each direction, so one fit serves all angles.
class Tail {
  constructor(flight) {
    const { start, live, moving, held, zero } = flight, places = (nodes) => Array.from(nodes).flatMap((node) => Array.from(start.subarray(3 * node, 3 * node + 3)));
    Object.assign(this, { flight, columns: live.columns, onTail: moving.length, inMesh: moving.length + held.length });
    this.sites = Float64Array.from([...places(moving), ...places(held), ...zero]);
    this.count = this.sites.length / 3;
    this.values = new Float64Array(this.count * this.columns);
    moving.forEach((node, i) => {
      const row = live.rows.indexOf(node);
      this.values.set(live.fields.subarray(row * this.columns, (row + 1) * this.columns), i * this.columns);
    });
    this.free = Float64Array.from(places(flight.free));
    this.scaled = scaling(this.sites);
    this.lattice = latticePlaces(flight);
    this.known = {};
  }

  // What an interpolant of the sites in `centres` does to free nodes, sites and lattice; sites up to `most` are counted.
  field(centres, most = this.count) {
    const found = new Interpolant(this.sites, this.values, this.columns, centres, this.scaled);
    return { found, centres, most, nodes: found.at(this.free), sites: found.at(this.sites), lattice: found.at(this.lattice.inside) };
  }

  // Whether a field has the sites on the box.
  holds(field) {
    return field.most === this.count;
  }

  withoutBox() {
    this.known.withoutBox = this.known.withoutBox || this.field([...Array(this.inMesh).keys()], this.inMesh);
    return this.known.withoutBox;
  }

  // Every site is a centre: computed beforehand, since it takes seconds here.
  withAll() {
    const { whole, lattice } = this.flight;
    return { centres: null, most: this.count, nodes: whole, sites: this.values, lattice: lattice.whole };
  }

  greedy() {
    return this.field(this.flight.meta.start.slice());
  }

  // Add the site with the largest error at an angle, `count` times.
  more(field, count, angle) {
    let found = field.found, { centres, sites } = field;
    for (let k = 0; k < count; k += 1) {
      centres = [...centres, worst(this.errors({ sites }, angle), centres)];
      found = new Interpolant(this.sites, this.values, this.columns, centres, this.scaled);
      sites = found.at(this.sites);
    }
    return this.field(centres);
  }

  // Distances of a field from the displacements of the sites, at an angle.
  errors({ sites }, angle) {
    const { columns, flight: { live } } = this, now = live.values(angle), a = [0, 0, 0], b = [0, 0, 0];
    return Float64Array.from({ length: this.count }, (_, i) => {
      displaced(sites, columns, now, i, a);
      displaced(this.values, columns, now, i, b);
      return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
    });
  }

  largest(field, angle) {
    return Math.max(...this.errors(field, angle).subarray(0, field.most));
  }

  // The largest displacement of sites from a row to another, at an angle.
  motion(sites, from, to, angle) {
    const now = this.flight.live.values(angle), move = [0, 0, 0];
    let most = 0;
    for (let i = from; i < to; i += 1) most = Math.max(most, Math.hypot(...displaced(sites, this.columns, now, i, move)));
    return most;
  }

  jump(field, angle) {
    return this.motion(field.sites, this.inMesh, this.count, angle);
  }

  // Write where a field takes the free nodes.
  place(field, angle, out) {
    const { free, start, live } = this.flight, now = live.values(angle), move = [0, 0, 0];
    free.forEach((node, i) => {
      displaced(field.nodes, this.columns, now, i, move);
      for (let c = 0; c < 3; c += 1) out[3 * node + c] = start[3 * node + c] + move[c];
    });
  }
}

// Places of the lattice in the section: rows of [x, z, number among those in the box, or -1], and the latter as points.
function latticePlaces({ lattice, meta }) {
  const { origin, shape, step } = lattice, number = new Map(lattice.inside.map((place, i) => [place, i]));
  const rows = Array.from({ length: shape[0] }, (_, j) => Array.from({ length: shape[1] }, (__, i) => (
    [origin[0] + i * step, origin[1] + j * step, number.has(j * shape[1] + i) ? number.get(j * shape[1] + i) : -1])));
  return { rows, inside: Float64Array.from(rows.flat().filter((place) => place[2] >= 0).flatMap(([x, z]) => [x, meta.section, z])) };
}
