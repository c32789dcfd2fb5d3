// How finely the map is drawn while the view moves: as finely as there is time for. At rest it is
// drawn as finely as can be.

const DETAILS = ["smooth", "rough", "coarse"];
// Frames that take longer (ms) on average are slow; the longest there are count as no longer than
// this, so that one alone decides nothing.
const SLOW = 40, LONGEST = 100;
const FRAMES = 4;
// A view is at rest when it has not moved for so long (ms).
const REST = 200;

class Detail {
  level = 0;
  mean = 0;
  before = null;
  moved = 0;
  rested = { frames: 0, since: 0, longest: 0 };

  // A frame of a view that moves: how finely to draw it.
  moving(now) {
    this.timed(now);
    this.before = this.moved = now;
    this.rested = { frames: 0, since: now, longest: 0 };
    return DETAILS[this.level];
  }

  // What was drawn took until the next frame, whether the view still moves or not.
  timed(now) {
    if (this.before === null) return;
    this.mean += (Math.min(now - this.before, LONGEST) - this.mean) / FRAMES;
    this.before = null;
    if (this.mean <= SLOW || this.level === DETAILS.length - 1) return;
    this.level += 1;
    this.mean = 0;
  }

  // A frame of a view that stands still: whether it is at rest.
  rests(now) {
    this.timed(now);
    const isStill = now - this.moved >= REST;
    if (isStill) this.mean = 0;
    else if (this.level) return false;
    // The frames after the finest tell how long that one took, and so what the next motion begins
    // with.
    const { rested } = this;
    rested.frames += 1;
    if (rested.frames > 1) rested.longest = Math.max(rested.longest, now - rested.since);
    rested.since = now;
    if (rested.frames === FRAMES) this.begin(rested.longest);
    return true;
  }

  // Nothing is drawn meanwhile, as where the page is hidden: how long that took tells nothing.
  pause() {
    this.before = null;
    this.rested.frames = FRAMES;
  }

  begin(longest) {
    if (longest < SLOW) this.level = Math.max(0, this.level - 1);
    else if (longest > LONGEST) this.level = Math.max(1, this.level);
  }
}
