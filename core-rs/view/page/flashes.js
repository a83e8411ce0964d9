// Flashes of contacts and of ergons that strike, and the room that they may take.
//
// WCAG 2.3.1: a general flash covers more than a quarter of some 341 × 256 px of a picture of 1024 × 768. Where all flashes of an
// instant together cover less, there is none, however often they come. So discs are drawn smaller where they would cover more.

export const SHARE = (341 * 256) / 4 / (1024 * 768); // of the picture
const FAINT = 1e-5; // of the greatest impulse of a part: ergons below it are not seen
const FADE = 0.15; // [s] in which the flash of a contact has faded

/** How bright a contact is `since` it was felt [s], from 0 to 1, by its force over the greatest. */
export function contactFlash(since, share) {
  return since < 0 || since > FADE ? 0 : (1 - since / FADE) ** 2 * Math.max(0, 1 + Math.log10(share + 1e-9) / 3);
}

/** How an ergon is seen `d` [s] before it strikes, by its share of the greatest impulse: size and light, which swell where it does. */
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

/** By what the radii of discs [px] are multiplied so that all of them cover no more than may flash. */
export function held(radii, width, height) {
  const most = SHARE * width * height;
  let covered = 0;
  for (const r of radii) covered += Math.PI * r * r;
  return covered > most ? Math.sqrt(most / covered) : 1;
}
