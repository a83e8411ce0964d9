// Flashes of contacts and of ergons, and the area that they may cover.
//
// WCAG 2.3.1: a general flash covers more than a quarter of any 341 × 256 px of a picture of 1024 × 768. If all flashes
// of an instant together cover less, no general flash occurs, however often they come. Therefore discs are drawn
// smaller if they would cover more.

export const SHARE = (341 * 256) / 4 / (1024 * 768); // of the picture
const FAINT = 1e-5; // of the greatest impulse of a part: ergons below it are not seen
const FADE = 0.15; // [s] in which the flash of a contact has faded

/** Brightness of a contact from 0 to 1, `since` its push [s]; `share`: its force over the greatest. */
export function contactFlash(since, share) {
  return since < 0 || since > FADE ? 0 : (1 - since / FADE) ** 2 * Math.max(0, 1 + Math.log10(share + 1e-9) / 3);
}

/** Size and light of a spark `d` [s] before it strikes; both are largest at the strike. `share`: of the greatest impulse. */
export function spark(d, reach, share) {
  const size = Math.min(1, Math.max(0.5, 1 + 0.07 * Math.log2(share + 1e-6)));
  const flash = Math.exp(-((d / (0.035 * reach)) ** 2));
  if (share < FAINT) return { size: 0, light: 0 };
  const life = d > 0 ? 1 - smooth((d / reach - 0.6) / 0.4) : 1 - smooth(-d / (0.3 * reach));
  return { size: size * (1 + 1.25 * flash), light: size * life * (0.9 + 0.8 * flash) };
}

function smooth(x) {
  const s = Math.min(1, Math.max(0, x));
  return s * s * (3 - 2 * s);
}

/** Factor of the radii of discs [px] with which all of them together cover no more than may flash. */
export function held(radii, width, height) {
  const most = SHARE * width * height;
  let covered = 0;
  for (const r of radii) covered += Math.PI * r * r;
  return covered > most ? Math.sqrt(most / covered) : 1;
}
