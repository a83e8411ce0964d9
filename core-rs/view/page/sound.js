// What is heard with the picture. While it sounds, the picture follows it: a sound card's clock is not the computer's.

const FAR = 0.1; // [s] beyond which the picture jumps to the sound
const PULL = 0.1; // of the difference, in a picture: jitter of the browser's clock is smoothed

export class Sound {
  /** `tells(words)`: where a browser lets nothing sound before a key or click, or there is nothing to play. */
  constructor(alignment, tells) {
    this.alignment = alignment;
    this.audio = new Audio();
    this.tells = tells;
    this.wanted = true;
    this.isRefused = false;
    this.isThere = false;
    for (const kind of ["keydown", "pointerdown"]) addEventListener(kind, () => (this.isRefused = false), true);
  }

  /** Fetches all of it. */
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

  /** Sound and clock go together: only at the piece's own speed is there any. */
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
      clock.t += Math.abs(away) > FAR ? away : PULL * away;
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
