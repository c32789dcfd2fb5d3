// Measures from one place of the map to another: both are clicked.

const NEXT = ["Click where to measure from.", "Click where to measure to.", ""];

function rulerOf({ map, camera, redraw, number }, marks, inks) {
  // Whether clicks measure; no place, the first, or both.
  let isOn = false, ends = [];

  function set(on, places = []) {
    [isOn, ends] = [on, places];
    element("measure").setAttribute("aria-pressed", isOn);
    redraw();
  }

  return {
    set,
    change: () => set(!isOn),
    isOn: () => isOn,

    take(place) {
      if (place) set(true, ends.length === 1 ? [...ends, place] : [place]);
    },

    // The ends in the map frame, as an address has them; null: none.
    places: () => (ends.length ? ends.flatMap((end) => add(end, map.origin).map(number)) : null),

    // Until the second end is clicked, the place under the cursor stands for it.
    draw(cursor) {
      const places = ends.length === 1 && cursor ? [...ends, cursor] : ends;
      const told = places.length === 2 ? lengths(places) : {};
      marks.clear();
      marks.draw(camera, places, told.distance === undefined ? "" : number(told.distance), inks());
      const lines = Object.entries(told).map(([name, length]) => `${name.padEnd(10)} ${number(length)}`);
      if (isOn && NEXT[ends.length]) lines.push(NEXT[ends.length]);
      element("measured").textContent = lines.join("\n");
    },
  };
}

function lengths([from, to]) {
  const [x, y, z] = add(to, from, -1);
  return { distance: Math.hypot(x, y, z), horizontal: Math.hypot(x, y), vertical: Math.abs(z) };
}
