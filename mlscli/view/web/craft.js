// Does a craft of chosen size fit? Clicks set the way that its middle flies, above what is clicked.

const SAID_MOST = 6; // stretches that are told

function craftOf({ map, camera, redraw, number }, marks, inks) {
  const fields = ["width", "height", "above"].map((name) => element(`fit-${name}`));
  // Whether clicks set the way, where they were, and what was found.
  let isOn = false, clicked = [], found = null;

  const first = [...map.craft, map.craft[1] / 2 + map.cell_size];
  const sizes = () => fields.map((field) => Number(field.value));
  const way = () => clicked.map((place) => add(add(place, map.origin), [0, 0, sizes()[2]]));

  function set(on, places = [], size = sizes()) {
    [isOn, clicked] = [on, places];
    fields.forEach((field, i) => { field.value = number(size[i]); });
    element("fit").setAttribute("aria-pressed", isOn);
    element("fit-craft").hidden = !isOn;
    element("fit-legend").hidden = !isOn && !map.layers.some(
      ({ name, when }) => name === "clearance" && when.length,
    );
    find();
  }

  function find() {
    const [width, height, above] = sizes(), most = MOST_CELLS * map.cell_size;
    const isCraft = width > 0 && height > 0 && Math.max(width, height) <= most;
    found = null;
    let said = "";
    if (isOn && !isCraft) said = `A craft has a width and a height, up to ${short(most)}.`;
    else if (isOn && !Number.isFinite(above)) said = "Say how high above what is clicked it flies.";
    else if (isOn && !clicked.length) said = "Click where the craft flies.";
    else if (isOn) {
      try {
        found = clearanceOf(map, way(), width, height);
        said = told(found);
      } catch (error) {
        said = `This cannot be told: ${error.message}.`;
      }
    }
    element("fitted").textContent = said;
    redraw();
  }

  function told({ verdicts, distances, places, along, reach }) {
    const at = narrowestOf({ distances }), least = distances[at];
    const overall = verdicts.reduce((worst, each) => Math.max(worst, each), FITS);
    const middle = add(places[at], places[at + 1]).map((value) => number(value / 2));
    const lines = [
      VERDICTS[overall],
      least === Infinity
        ? `nothing within ${number(reach)}`
        : `narrowest ${number(least)} at ${middle.join(",")}`,
    ];
    const stretches = stretchesOf({ verdicts, along });
    for (const { verdict, begin, end } of stretches.slice(0, SAID_MOST)) {
      lines.push(`${number(begin)} to ${number(end)} ${VERDICTS[verdict]}`);
    }
    const more = stretches.length - SAID_MOST;
    if (more > 0) lines.push(`and ${more} more`);
    if (!map.seen) lines.push("The map does not say what was seen.");
    return lines.join("\n");
  }

  const rgb = (colour) => `rgb(${colour.map(Math.round)})`;
  const { blocked, doubtful, unseen, touching, clear } = map.fitting;
  const colourOf = (verdict, distance, reach) => {
    if (verdict !== FITS) return rgb({ [BLOCKED]: blocked, [DOUBTFUL]: doubtful, [NEVER_SEEN]: unseen }[verdict]);
    const share = Math.max(0, Math.min(1, distance / reach));
    return rgb(touching.map((value, i) => value + share * (clear[i] - value)));
  };

  const scale = `linear-gradient(to right, ${rgb(touching)}, ${rgb(clear)})`;
  element("fit-legend").append(...[
    [rgb(blocked), "does not fit"], [rgb(doubtful), "nearer than the map can tell"],
    [rgb(unseen), "never seen"], [scale, "fits: touching, to clear of all"],
  ].map(([colour, text]) => {
    const row = made("li"), patch = made("i");
    patch.style.background = colour;
    row.append(patch, made("span", text));
    return row;
  }));
  for (const field of fields) field.addEventListener("input", find);

  const undo = () => { if (isOn) set(true, clicked.slice(0, -1)); };
  element("fit-undo").addEventListener("click", undo);
  element("fit-anew").addEventListener("click", () => set(true));
  set(false, [], first);

  return {
    undo,
    isOn: () => isOn,
    off: () => set(false),
    change: () => set(!isOn),
    take(place) {
      if (place) set(true, [...clicked, place]);
    },

    // The craft and the places clicked, in the map frame, as an address has them; null: none.
    words: () => (isOn
      ? [...sizes(), ...clicked.flatMap((place) => add(place, map.origin))].map(number)
      : null),

    // What an address says: sizes, and places of three numbers each; else none.
    read(words) {
      const numbers = words && words.length % 3 === 0 ? numbersOf(words, words.length) : null;
      if (!numbers?.length) return set(false, [], first);
      const places = [];
      for (let i = 3; i < numbers.length; i += 3) {
        places.push(add(numbers.slice(i, i + 3), map.origin, -1));
      }
      return set(true, places, numbers.slice(0, 3));
    },

    draw() {
      if (!found) return;
      const { places, verdicts, distances, reach } = found;
      const local = places.map((place) => add(place, map.origin, -1));
      const colours = verdicts.map((verdict, n) => colourOf(verdict, distances[n], reach));
      const at = narrowestOf({ distances });
      const ring = distances[at] < Infinity
        ? add(local[at], local[at + 1]).map((value) => value / 2) : null;
      marks.way(camera, local, colours, ring, inks());
    },
  };
}
