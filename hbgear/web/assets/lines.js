"use strict";
/* Smooth lines through the points of a curve: the same Akima interpolation as in hbgear.plot.branch_sections. */
const hbgearLines = (() => {
  const LONGEST_CHORD = 0.004, MOST_CHORDS = 8, COINCIDENCE = 1e-9; // relative to the range of the values
  const CONSTANT_RANGE = 1e-8; // range of values, relative to the largest one, that is rounding errors

  const rangeOf = (v) => v.reduce((r, a) => [Math.min(r[0], a), Math.max(r[1], a)], [Infinity, -Infinity]);

  function distances(x, y) { // along the polygon, each coordinate relative to its range
    const [kx, ky] = [x, y].map((v) => {
      const [low, high] = rangeOf(v);
      return high - low > CONSTANT_RANGE * Math.max(Math.abs(low), Math.abs(high)) ? 1 / (high - low) : 0;
    });
    const along = [0];
    for (let i = 1; i < x.length; i++) along.push(along[i - 1] + Math.hypot(kx * (x[i] - x[i - 1]), ky * (y[i] - y[i - 1])));
    return along;
  }

  function slopes(t, v) { // Akima's derivatives at the knots t
    const m = [0, 0];
    for (let i = 1; i < t.length; i++) m.push((v[i] - v[i - 1]) / (t[i] - t[i - 1]));
    m[1] = 2 * m[2] - m[3];
    m[0] = 2 * m[1] - m[2];
    const n = m.length;
    m.push(2 * m[n - 1] - m[n - 2]);
    m.push(2 * m[n] - m[n - 1]);
    const turn = (i) => Math.abs(m[i + 1] - m[i]), weights = t.map((_, i) => turn(i + 2) + turn(i));
    const least = COINCIDENCE * rangeOf(weights)[1];
    return t.map((_, i) => (weights[i] > least ? (turn(i + 2) * m[i + 1] + turn(i) * m[i + 2]) / weights[i] : 0.5 * (m[i] + m[i + 3])));
  }

  function cubic(t, v, d, i, s) { // value between the knots i and i + 1
    const h = t[i + 1] - t[i], u = (s - t[i]) / h, m = (v[i + 1] - v[i]) / h;
    return v[i] + h * u * (d[i] + u * (3 * m - 2 * d[i] - d[i + 1] + u * (d[i] + d[i + 1] - 2 * m)));
  }

  /* Vertices of the line from one point to another: x, y, and the number of the nearest point. */
  function smooth(x, y) {
    const known = [...x, ...y].every((v) => v !== null && isFinite(v)), along = known ? distances(x, y) : [];
    const kept = along.map((_, i) => i).filter((i) => i === 0 || along[i] - along[i - 1] > COINCIDENCE);
    const t = kept.map((i) => along[i]), enough = kept.length >= 5;
    const coordinates = enough ? [x, y].map((v) => { const at = kept.map((i) => v[i]); return [at, slopes(t, at)]; }) : [];
    return (first, last) => {
      const out = { x: [x[first]], y: [y[first]], point: [first] };
      for (let i = first, k = 0; i < last; i++) {
        const length = along[i + 1] - along[i], bent = enough && last - first > 1;
        const parts = bent ? Math.min(MOST_CHORDS, Math.max(1, Math.ceil(length / LONGEST_CHORD))) : 1;
        while (parts > 1 && t[k + 1] <= along[i]) k++;
        for (let n = 1; n < parts; n++) {
          const s = along[i] + (length * n) / parts;
          out.x.push(cubic(t, ...coordinates[0], k, s));
          out.y.push(cubic(t, ...coordinates[1], k, s));
          out.point.push(2 * n < parts ? i : i + 1);
        }
        out.x.push(x[i + 1]); out.y.push(y[i + 1]); out.point.push(i + 1);
      }
      return out;
    };
  }

  function smoothParts(x, y) { // a line with gaps: each part between unknown values by itself
    const out = { x: [], y: [] };
    for (let first = 0; first < x.length; first++) {
      if (x[first] === null || y[first] === null) continue;
      let last = first;
      while (last + 1 < x.length && x[last + 1] !== null && y[last + 1] !== null) last++;
      const part = smooth(x.slice(first, last + 1), y.slice(first, last + 1))(0, last - first);
      if (out.x.length) { out.x.push(null); out.y.push(null); }
      out.x.push(...part.x); out.y.push(...part.y);
      first = last;
    }
    return out;
  }

  return { smooth, smoothParts };
})();
