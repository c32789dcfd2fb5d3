// The panel: layers, what is coloured by, light or dark.

const LABELS = {
  surface: "Surfaces", walls: "Walls", artificial: "Artificial (uncertain)",
  route: "Route on the ground", track: "Route in the air", patches: "Patches as points",
  depths: "Depths as lines", points: "Points of the recording",
  views: "Where to look next", clearance: "Does the craft fit",
};

// A number in as few digits as a scale needs.
const short = (value) => `${Number(value.toPrecision(3))}`;

function layersOf({ map, redraw }) {
  const first = map.layers.filter((layer) => layer.shown).map(({ name }) => name);

  map.layers.forEach((layer, place) => {
    if (!layer.when.length) return;
    const box = Object.assign(document.createElement("input"), {
      type: "checkbox", id: `layer-${layer.name}`, checked: layer.shown,
    });
    box.addEventListener("change", () => { layer.shown = box.checked; redraw(); });
    const label = made("label"), held = made("small", layer.when.length.toLocaleString("en"));
    label.append(box, made("span", LABELS[layer.name]), held);
    label.title = `key ${place + 1}`;
    element("layers").append(label);
  });

  return {
    click: (layer) => element(`layer-${layer.name}`)?.click(),

    // The names of those that are shown; null: those that are at first.
    shown() {
      const names = map.layers.filter((layer) => layer.shown).map(({ name }) => name);
      return names.join() === first.join() ? null : names;
    },

    show(names) {
      for (const layer of map.layers) {
        const box = element(`layer-${layer.name}`);
        layer.shown = (names ?? first).includes(layer.name);
        if (box) box.checked = layer.shown;
      }
      redraw();
    },
  };
}

function colouringOf({ map, scene, redraw }) {
  const choice = element("colouring"), colours = [];
  for (let i = 0; i < map.scale.length; i += 3) colours.push(`rgb(${map.scale.slice(i, i + 3)})`);
  element("colours").style.background = `linear-gradient(to right, ${colours})`;
  choice.append(...map.colourings.map(({ name }) => made("option", name)));
  choice.addEventListener("change", () => { paint(); choice.blur(); });

  function paint() {
    const place = choice.selectedIndex;
    // Walls are coloured by height all the way up, and not as their patches are.
    scene.paint(place ? map.colourings[place].colour : null);
    showLegend();
    redraw();
  }

  function showLegend() {
    const { name, label, ends, kinds } = map.colourings[choice.selectedIndex];
    element("ramp").hidden = !ends;
    if (ends) [element("lowest").textContent, element("highest").textContent] = ends.map(short);
    element("label").textContent = label === name ? "" : label;
    const route = map.keyframes > 1 ? [[map.green, "route"]] : [];
    element("kinds").replaceChildren(...[...kinds, ...route].map(([colour, text]) => {
      const row = made("li"), patch = made("i");
      patch.style.background = `rgb(${colour})`;
      row.append(patch, made("span", text));
      return row;
    }));
  }

  showLegend();
  return {
    // What is coloured by; null: height, as at first.
    chosen: () => (choice.selectedIndex ? choice.value : null),

    choose(name) {
      const place = Math.max(0, map.colourings.findIndex((way) => way.name === name));
      if (place === choice.selectedIndex) return;
      choice.selectedIndex = place;
      paint();
    },

    next() {
      choice.selectedIndex = (choice.selectedIndex + 1) % choice.length;
      paint();
    },
  };
}

function lightOf({ state, redraw }) {
  function set(theme) {
    document.documentElement.dataset.theme = theme;
    const colour = getComputedStyle(document.body).backgroundColor;
    state.background = colour.match(/[\d.]+/g).slice(0, 3).map((channel) => channel / 255);
    redraw();
  }

  set(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  return {
    change: () => set(document.documentElement.dataset.theme === "dark" ? "light" : "dark"),

    inks() {
      const style = getComputedStyle(document.documentElement);
      return { ink: style.getPropertyValue("--ink"), paper: style.getPropertyValue("--paper") };
    },
  };
}
