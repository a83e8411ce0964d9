// The sound to the picture. While it plays, the picture follows it, because the clock of a sound card is not that of
// the computer.

const JUMP_BEYOND = 0.1; // [s] beyond which the picture jumps to the sound
const CORRECTION = 0.1; // share of the difference that is corrected in a picture: smooths the jitter of the browser's clock

export class Sound {
  /** `tells(words)`: shows why there is no sound, such as a browser that waits for a key or click. */
  constructor(alignment, tells) {
    this.alignment = alignment;
    this.audio = new Audio();
    this.tells = tells;
    this.wanted = true;
    this.isRefused = false;
    this.isThere = false;
    for (const kind of ["keydown", "pointerdown"]) addEventListener(kind, () => (this.isRefused = false), true);
  }

  /** Fetches the whole file. */
  async load(address) {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(`${answer.status}`);
    this.audio.src = URL.createObjectURL(await answer.blob());
    await new Promise((loaded, failed) => {
      this.audio.addEventListener("loadedmetadata", loaded);
      this.audio.addEventListener("error", () => failed(this.audio.error));
    });
    this.isThere = true;
  }

  get sounds() {
    return !this.audio.paused && !this.audio.ended;
  }

  /** On or off. */
  toggle() {
    this.wanted = !this.wanted;
  }

  /** Keeps sound and clock together; there is sound only at the piece's own speed. */
  follow(clock) {
    const { audio } = this;
    const may = this.isThere && this.wanted && clock.runs && clock.rate === 1 && !this.isRefused && !(clock.t >= audio.duration);
    if (!may) {
      if (this.sounds) audio.pause();
      return;
    }
    const { ahead } = this.alignment;
    const away = audio.currentTime + ahead - clock.t;
    if (!this.sounds) {
      if (Math.abs(away) > 0.01) audio.currentTime = Math.max(0, clock.t - ahead);
      this.begin();
    } else if (clock.jumped) {
      audio.currentTime = Math.max(0, clock.t - ahead);
    } else if (!audio.seeking) {
      clock.t += Math.abs(away) > JUMP_BEYOND ? away : CORRECTION * away;
    }
    clock.jumped = false;
  }

  begin() {
    this.audio.play().then(
      () => this.tells(""),
      (error) => {
        if (error.name !== "NotAllowedError") return; // paused again before it began
        this.isRefused = true;
        this.tells("Press a key or click to hear it.");
      },
    );
  }
}
