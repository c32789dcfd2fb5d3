// The page around the picture: it puts the parts together, and draws when something has changed.

const NARROW = 700; // pixels; in less the panel is folded at first

async function main() {
  const map = await load();
  const canvas = element("canvas"), marks = new Marks(element("marks"));
  const scene = new Scene(canvas, map), camera = new Camera(...map.box, map.cell_size);
  const state = {
    latest: 0, cursor: null, background: [1, 1, 1],
    // Whether the picture and what is told of the cursor are out of date.
    dirty: true, asked: true,
    // How finely the picture is drawn.
    detail: null,
  };
  const detail = new Detail();
  const number = (value) => value.toFixed(map.digits);
  const redraw = () => { state.dirty = true; };
  const ask = () => { state.asked = true; };
  const page = { map, canvas, scene, camera, state, redraw, ask, number };

  const isNarrow = canvas.clientWidth < NARROW;
  element("panel").open = !isNarrow;
  // The view is held by the part of the window that is as far from its middle as the panel.
  const whole = () => camera.reset(
    isNarrow ? canvas.clientWidth : Math.max(canvas.clientWidth - 520, canvas.clientWidth / 2),
    canvas.clientHeight,
  );
  whole();

  const flight = flightOf(page), layers = layersOf(page), colouring = colouringOf(page);
  const light = lightOf(page), cutting = cuttingOf(page), ruler = rulerOf(page, marks, light.inks);
  const craft = craftOf(page, marks, light.inks);
  const address = addressOf(page, { flight, layers, colouring, cutting, ruler, craft });

  function mark(cursor) {
    ruler.draw(cursor);
    craft.draw();
  }

  function drawn(now) {
    if (state.dirty) {
      Object.assign(state, { dirty: false, asked: true });
      draw(detail.moving(now));
      drawAxes(camera);
      drawScale(scaleOf(camera, canvas.clientHeight));
      mark(null);
    } else if (detail.rests(now)) {
      if (state.detail !== "smooth") draw("smooth");
      if (state.asked) tell();
      state.asked = false;
    }
    const { dataset } = document.documentElement;
    [dataset.detail, dataset.view] = [state.detail, state.asked ? "moving" : "still"];
    requestAnimationFrame(drawn);
  }

  function draw(how) {
    scene.draw(camera, state.background, state.latest, how);
    state.detail = how;
  }

  function save() {
    // What was drawn in an earlier frame is gone.
    draw("smooth");
    const scale = scaleOf(camera, canvas.clientHeight);
    savePicture([canvas, marks.canvas], { title: map.title, scale, ...light.inks() });
  }

  // --- what is under the cursor ---

  function pick(how = "smooth") {
    return state.cursor && scene.pick(camera, ...state.cursor, state.latest, how);
  }

  function tell() {
    const hit = pick();
    element("readout").textContent = hit ? describe(add(hit, map.origin)) : "";
    mark(hit);
    address.write();
  }

  function describe([x, y, z]) {
    const at = `x ${number(x)}  y ${number(y)}  z ${number(z)}`;
    const i = patchAt(map, x, y, z);
    if (i < 0) return at;
    const { height, depth, origin, moved, count, first_keyframe, last_keyframe } = map.patches;
    const parts = [`${map.origins[origin[i]]} patch: height ${number(height[i])}`];
    if (depth[i] > 0) parts.push(`depth ${number(depth[i])}`);
    if (moved[i]) parts.push("moved beyond its points");
    if (count[i]) {
      parts.push(`${count[i]} point${count[i] > 1 ? "s" : ""}`);
      const [first, final] = [first_keyframe[i] + 1, last_keyframe[i] + 1];
      if (flight.last > 0) {
        parts.push(first < final ? `keyframes ${first} to ${final}` : `keyframe ${first}`);
      }
    }
    return `${at}\n${parts.join(", ")}`;
  }

  // --- mouse, touch, keys and buttons ---

  const help = element("help");
  // Clicks do one thing at a time.
  const measure = () => { craft.off(); ruler.change(); };
  const fit = () => { ruler.set(false); craft.change(); };
  const acts = {
    c: colouring.next, l: light.change, m: measure, v: fit, p: save,
    x: cutting.next, o: cutting.turn, "[": () => cutting.step(-1), "]": () => cutting.step(1),
    "?": () => help.toggleAttribute("hidden"),
    Backspace: craft.undo,
    Escape: () => { help.hidden = true; ruler.set(false); craft.off(); },
  };
  pointersOf(page, pick, () => {
    const tool = [craft, ruler].find((each) => each.isOn());
    if (tool) tool.take(pick());
  });
  keysOf(page, { whole, flight, layers, ...acts });
  for (const [name, act] of [
    ["measure", measure], ["fit", fit], ["save", save], ["light", light.change],
    ["keys", acts["?"]], ["close", acts["?"]],
  ]) element(name).addEventListener("click", act);
  window.addEventListener("resize", redraw);
  window.addEventListener("hashchange", () => { whole(); address.read(); });
  document.addEventListener("visibilitychange", () => detail.pause());

  document.title = `${map.title} · mls`;
  element("title").textContent = map.title;
  element("about").textContent =
    `${map.patches.ix.length.toLocaleString("en")} patches, cells of ${map.cell_size}, frame ${map.frame}`;
  address.read();
  requestAnimationFrame(drawn);
  document.documentElement.dataset.ready = "yes";
}

main().catch((error) => {
  element("failure").textContent = `The map cannot be shown: ${error.message}.`;
  element("failure").hidden = false;
  throw error;
});
