// Frames of a file: each point in steps of its own, as differences from what is foreseen, in the bits of a range coder
// with adaptive chances (docs/motion.md).

const CHANCE_BITS = 15; // of the chance of a 0
const EVEN = 1 << 14;
const RATE = 4;
const RANGE_MIN = 2 ** 24;
const LENGTHS = 21; // lengths of numbers that have chances of their own
const LENGTH_MAX = 60; // bits of the largest number
const CODE_MAX = 200; // of a step
const CONTEXTS = 15; // of differences
const BLOCK = 20; // frames in which a point either rests or moves
const MODE_BITS = 3;
const [REST, , LINE, BESIDE, AHEAD] = [0, 1, 2, 3, 4];

class Bits {
  constructor(bytes) {
    this.bytes = bytes;
    this.next = 0;
    this.range = 0xffffffff;
    this.code = 0;
    for (let i = 0; i < 5; i++) this.shift();
  }

  shift() {
    this.code = ((this.code << 8) | (this.bytes[this.next++] ?? 0)) >>> 0;
  }

  /** A bit of a known chance. */
  plain(chance) {
    const bound = (this.range >>> CHANCE_BITS) * chance;
    const bit = this.code >= bound;
    if (bit) {
      this.code -= bound;
      this.range -= bound;
    } else this.range = bound;
    while (this.range < RANGE_MIN) {
      this.range = (this.range << 8) >>> 0;
      this.shift();
    }
    return bit;
  }

  /** A bit from which its chance is learnt. */
  learn(chances, i) {
    const bit = this.plain(chances[i]);
    if (bit) chances[i] -= chances[i] >> RATE;
    else chances[i] += ((1 << CHANCE_BITS) - chances[i]) >> RATE;
    return bit;
  }

  /** A number ≥ 0: its length, then its bits. `chances`: those of a context. */
  number({ lengths, firsts }) {
    let length = 0;
    while (this.learn(lengths, Math.min(length, LENGTHS - 1))) {
      if (++length > LENGTH_MAX) throw new Error("a number in frames is longer than any may be");
    }
    let number = 1;
    for (let place = length - 1; place >= 0; place--) {
      const bit = place === length - 1 ? this.learn(firsts, Math.min(length, LENGTHS - 1)) : this.plain(EVEN);
      number = 2 * number + (bit ? 1 : 0);
    }
    return number - 1;
  }

  negative(size) {
    return size !== 0 && this.plain(EVEN) ? -size : size;
  }
}

const even = (count) => new Uint16Array(count).fill(EVEN);
const context = () => ({ lengths: even(LENGTHS), firsts: even(LENGTHS) });
const step = (code) => (4 + (code & 3)) * 2 ** (code >> 2);

/** Rows of displacements [m]: `count` frames of `n` points. Throws an Error if they are damaged. */
export function unpack(bytes, count, n) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
  const unit = view.getFloat64(0, true);
  const fine = view.getUint16(8, true);
  if (!(unit > 0 && unit < Infinity) || fine > CODE_MAX) throw new Error("the head of frames is damaged");
  const bits = new Bits(bytes.subarray(10));
  const rows = Array.from({ length: count }, () => new Float32Array(n));
  const [steps, firsts] = [context(), context()];
  const differences = Array.from({ length: CONTEXTS }, context);
  const modes = Array.from({ length: AHEAD + 1 }, () => even(1 << MODE_BITS));
  let [code, mode, last, beforeLast] = [0, 0, 0, 0];
  let [held, beside, second] = [0, 1, 2].map(() => new Float64Array(count)); // of this point and the two before it
  for (let point = 0; point < n; point++) {
    const zigzag = bits.number(steps);
    code += zigzag % 2 ? -(zigzag + 1) / 2 : zigzag / 2;
    if (!(code >= 0 && code <= CODE_MAX)) throw new Error("a step of frames is damaged");
    let size = 0;
    for (let t = 0; t < count; t++) {
      if (t % BLOCK === 0) {
        const chances = modes[mode];
        let number = 1;
        for (let i = 0; i < MODE_BITS; i++) number = 2 * number + (bits.learn(chances, number) ? 1 : 0);
        mode = number - (1 << MODE_BITS);
        if (mode > AHEAD) throw new Error("a mode of frames is damaged");
        size = step(mode === REST ? fine : code);
      }
      if (t === 0) {
        held[0] = size * bits.negative(bits.number(firsts));
      } else {
        let from = held[t - 1];
        if (mode === LINE) from += held[t - 1] - held[Math.max(0, t - 2)];
        else if (mode === BESIDE) from += beside[t] - beside[t - 1];
        else if (mode === AHEAD) from += 2 * (beside[t] - beside[t - 1]) - (second[t] - second[t - 1]);
        const sum = Math.min(2 ** CONTEXTS, Math.floor((2 * last + beforeLast + 1) / 2));
        const level = Math.min(CONTEXTS - 1, 32 - Math.clz32(sum)); // how many bits it has
        const difference = bits.number(differences[level]);
        [last, beforeLast] = [difference, last];
        held[t] = from + size * bits.negative(difference);
      }
      rows[t][point] = held[t] * unit;
    }
    [held, beside, second] = [second, held, beside];
  }
  if (bits.next !== bits.bytes.length) throw new Error("frames do not end where their bytes do");
  return rows;
}
