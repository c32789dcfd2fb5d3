// A plane that cuts the map open: what lies beyond it is not drawn, and not read by the cursor.

const WAYS = ["", "x", "y", "z", "seen"];
const AXES = { x: [1, 0, 0], y: [0, 1, 0], z: [0, 0, 1] };
const STEPS = 50; // from one end of the map to the other, by keys

class Cut {
  way = "";
  // Of a cut across what is seen: where its normal points, radians from +x.
  azimuth = 0;
  // Along the normal, from the map's origin.
  at = 0;
  // 1: what lies beyond is cut away, -1: what lies before.
  side = 1;

  constructor(map) {
    this.map = map;
  }

  normal() {
    return AXES[this.way] ?? [Math.cos(this.azimuth), Math.sin(this.azimuth), 0];
  }

  // From where to where along the normal the map reaches, and a little more: at its end all is seen.
  reach() {
    const [x, y, z] = this.normal();
    let low = Infinity, high = -Infinity;
    for (const { position } of [this.map.vertices.mesh, this.map.vertices.patches]) {
      for (let i = 0; i < position.length; i += 3) {
        const along = x * position[i] + y * position[i + 1] + z * position[i + 2];
        if (along < low) low = along;
        if (along > high) high = along;
      }
    }
    const more = this.map.cell_size / 10;
    return low <= high ? [low - more, high + more] : [0, 0];
  }

  // As the shaders take it: places with a product of more than the last number are cut away.
  plane() {
    if (!this.way) return [0, 0, 0, 1];
    return [...this.normal().map((value) => this.side * value), this.side * this.at];
  }

  // What is added to `at` for the coordinate in the map frame; across what is seen there is none.
  origin() {
    return dot(AXES[this.way] ?? [0, 0, 0], this.map.origin);
  }
}

// The cut as it is chosen and moved in the panel.
function cuttingOf({ scene: { cut }, camera, redraw, number }) {
  const slider = element("cut-at");

  function choose(way) {
    [cut.way, cut.azimuth] = [way, camera.yaw];
    const [low, high] = way ? cut.reach() : [0, 0];
    Object.assign(slider, { min: low, max: high });
    // What the camera has before it goes.
    cut.side = dot(cut.normal(), camera.axes().back) < 0 ? -1 : 1;
    move((low + high) / 2);
  }

  function move(at) {
    cut.at = Math.max(Number(slider.min), Math.min(Number(slider.max), at));
    slider.value = cut.at;
    element("cut").value = cut.way;
    element("cut-place").hidden = !cut.way;
    element("cut-told").textContent = `at ${number(cut.at + cut.origin())}`;
    redraw();
  }

  function turn() {
    cut.side = -cut.side;
    redraw();
  }

  element("cut").addEventListener("change", ({ target }) => { choose(target.value); target.blur(); });
  slider.addEventListener("input", () => move(Number(slider.value)));
  element("cut-side").addEventListener("click", turn);
  return {
    turn,
    next: () => choose(WAYS[(WAYS.indexOf(cut.way) + 1) % WAYS.length]),
    step: (steps) => cut.way && move(cut.at + steps * (slider.max - slider.min) / STEPS),

    // As an address has it; null: nothing is cut.
    words() {
      const place = number(cut.at + cut.origin());
      return cut.way ? [cut.way, place, cut.side, cut.azimuth.toFixed(3)] : null;
    },

    take([way, ...numbers]) {
      const [place, side, azimuth] = numbersOf(numbers, 3) ?? [];
      choose(WAYS.includes(way) && side ? way : "");
      if (!cut.way) return;
      [cut.side, cut.azimuth] = [Math.sign(side), azimuth];
      const [low, high] = cut.reach();
      Object.assign(slider, { min: low, max: high });
      move(place - cut.origin());
    },
  };
}
