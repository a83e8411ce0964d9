// A camera path along a piece: the view depends on the instant alone, so that a film gives the same pictures each time.

/**
 * Looks at t [s], by stops [t, look] in order: before the first and after the last these stand, between two of them one
 * becomes the other, slowly at both ends.
 */
export function tour(stops) {
  return (t) => {
    const next = stops.findIndex(([at]) => at > t);
    if (next === 0) return stops[0][1];
    if (next < 0) return stops.at(-1)[1];
    const [[from, a], [to, b]] = [stops[next - 1], stops[next]];
    const x = (t - from) / (to - from);
    return between(a, b, x * x * (3 - 2 * x));
  };
}

function between(a, b, share) {
  const mean = (u, v) => u + share * (v - u);
  const turn = ((((b.yaw - a.yaw) % (2 * Math.PI)) + 3 * Math.PI) % (2 * Math.PI)) - Math.PI; // the shorter way round
  return {
    target: a.target.map((v, i) => mean(v, b.target[i])),
    distance: a.distance * Math.pow(b.distance / a.distance, share),
    yaw: a.yaw + share * turn,
    pitch: mean(a.pitch, b.pitch),
  };
}
