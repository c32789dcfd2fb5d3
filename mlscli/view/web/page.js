// The page around the picture: layers, legend, what is under the cursor, the flight, and keys.

const element = (id) => document.getElementById(id);
const made = (tag, text = "") => Object.assign(document.createElement(tag), { textContent: text });
// A number in as few digits as a scale needs.
const short = (value) => `${Number(value.toPrecision(3))}`;
const LABELS = {
  surface: "Surfaces", walls: "Walls", artificial: "Artificial (uncertain)",
  route: "Route on the ground", track: "Route in the air", patches: "Patches as points",
  depths: "Depths as lines", points: "Points of the recording",
};
const TURN = Math.PI / 36;
const PLAYING = 12; // seconds that the whole flight takes

async function main() {
  const map = await load();
  const canvas = element("canvas");
  const scene = new Scene(canvas, map);
  const camera = new Camera(...map.box, map.cell_size);
  // The view is held by the part of the window that is as far from its middle as the panel.
  const whole = () => camera.reset(
    Math.max(canvas.clientWidth - 520, canvas.clientWidth / 2), canvas.clientHeight,
  );
  whole();
  const last = Math.max(map.keyframes - 1, 0);
  const state = {
    latest: last, cursor: null, playing: null, background: [1, 1, 1],
    // Whether the picture and what is told of the cursor are out of date.
    dirty: true, asked: true,
    // How finely the picture is drawn.
    detail: null,
  };
  const detail = new Detail();
  const digits = Math.max(0, Math.min(6, 2 - Math.floor(Math.log10(map.cell_size))));
  const number = (value) => value.toFixed(digits);
  const redraw = () => { state.dirty = true; };
  const ask = () => { state.asked = true; };

  function drawn(now) {
    if (state.dirty) {
      Object.assign(state, { dirty: false, asked: true });
      draw(detail.moving(now));
      drawAxes();
      drawScaleBar();
    } else if (detail.rests(now)) {
      if (state.detail !== "smooth") draw("smooth");
      if (state.asked) element("readout").textContent = describe();
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

  // --- what is under the cursor ---

  function pick(how = "smooth") {
    return state.cursor && scene.pick(camera, ...state.cursor, state.latest, how);
  }

  function describe() {
    const hit = pick();
    if (!hit) return "";
    const [x, y, z] = add(hit, map.origin);
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
      if (last > 0) parts.push(first < final ? `keyframes ${first} to ${final}` : `keyframe ${first}`);
    }
    return `${at}\n${parts.join(", ")}`;
  }

  // --- layers, legend, light ---

  function showLayers() {
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
  }

  function showColourings() {
    const colours = [];
    for (let i = 0; i < map.scale.length; i += 3) {
      colours.push(`rgb(${map.scale.slice(i, i + 3)})`);
    }
    element("colours").style.background = `linear-gradient(to right, ${colours})`;
    element("colouring").append(...map.colourings.map(({ name }) => made("option", name)));
    element("colouring").addEventListener("change", paint);
    showLegend();
  }

  function paint() {
    const place = element("colouring").selectedIndex;
    // Walls are coloured by height all the way up, and not as their patches are.
    scene.paint(place ? map.colourings[place].colour : null);
    showLegend();
    redraw();
  }

  function nextColouring() {
    const choice = element("colouring");
    choice.selectedIndex = (choice.selectedIndex + 1) % choice.length;
    paint();
  }

  function showLegend() {
    const { name, label, ends, kinds } = map.colourings[element("colouring").selectedIndex];
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

  function setLight(theme) {
    document.documentElement.dataset.theme = theme;
    const colour = getComputedStyle(document.body).backgroundColor;
    state.background = colour.match(/[\d.]+/g).slice(0, 3).map((channel) => channel / 255);
    redraw();
  }

  const theme = () => document.documentElement.dataset.theme;
  const switchLight = () => setLight(theme() === "dark" ? "light" : "dark");

  // --- scale and axes ---

  function drawScaleBar() {
    const widest = 160 * camera.pixel(canvas.clientHeight);
    const power = 10 ** Math.floor(Math.log10(widest));
    const length = [5, 2, 1].find((factor) => factor * power <= widest) * power;
    element("bar").style.width = `${length / camera.pixel(canvas.clientHeight)}px`;
    element("length").textContent = `${Number(length.toPrecision(1))}`;
  }

  function drawAxes() {
    const { right, up, back } = camera.axes();
    const arms = ["x", "y", "z"].map((name, i) => ({ name, x: right[i], y: -up[i], z: back[i] }));
    // What points away from the eye is drawn first.
    arms.sort((a, b) => a.z - b.z);
    for (const arm of arms) {
      const group = element(`axis-${arm.name}`), [line, text] = group.children;
      group.parentNode.append(group);
      line.setAttribute("x2", 30 * arm.x);
      line.setAttribute("y2", 30 * arm.y);
      text.setAttribute("x", 39 * arm.x);
      text.setAttribute("y", 39 * arm.y);
    }
  }

  // --- the flight ---

  function show(keyframe) {
    state.latest = Math.max(0, Math.min(last, Math.round(keyframe)));
    element("slider").value = state.latest;
    const time = map.times ? `, ${map.times[state.latest].toFixed(1)} s` : "";
    // Counted from 1, as by every command.
    element("keyframe").textContent = `keyframe ${state.latest + 1} of ${last + 1}${time}`;
    redraw();
  }

  function stop() {
    clearInterval(state.playing);
    state.playing = null;
    element("play").textContent = "▶";
  }

  function play() {
    if (state.playing !== null) return stop();
    let at = state.latest === last ? 0 : state.latest;
    let before = performance.now();
    element("play").textContent = "❚❚";
    show(at);
    state.playing = setInterval(() => {
      const now = performance.now();
      at += last * (now - before) / (1000 * PLAYING);
      before = now;
      show(at);
      if (at >= last) stop();
    }, 40);
  }

  // --- mouse, touch and keys ---

  const fingers = new Map();

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
  });
  for (const name of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
  }
  canvas.addEventListener("pointerleave", () => { state.cursor = null; ask(); });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    state.cursor = fingers.size ? null : [event.offsetX, event.offsetY];
    if (before) {
      const right = event.clientX - before.clientX, down = event.clientY - before.clientY;
      if (fingers.size === 2) pinch(event, before, right / 2, down / 2);
      else if (event.shiftKey || event.buttons & 6) camera.pan(right, down, canvas.clientHeight);
      else camera.turn(-right / 200, down / 200);
      fingers.set(event.pointerId, event);
      redraw();
    }
    ask();
  });

  function pinch(event, before, right, down) {
    const [other] = [...fingers.values()].filter((each) => each.pointerId !== event.pointerId);
    const apart = (one) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);
    camera.zoom(apart(before) / Math.max(apart(event), 1));
    camera.pan(right, down, canvas.clientHeight);
  }

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    state.cursor = [event.offsetX, event.offsetY];
    const lines = event.deltaMode === 1 ? 30 : 1;
    const step = Math.max(-200, Math.min(200, event.deltaY * lines));
    camera.zoom(1.0015 ** step, pick(state.detail) || camera.target);
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => { camera.target = pick() || camera.target; redraw(); });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  window.addEventListener("resize", redraw);
  document.addEventListener("visibilitychange", () => detail.pause());

  const keys = {
    ArrowLeft: () => camera.turn(-TURN, 0), ArrowRight: () => camera.turn(TURN, 0),
    ArrowUp: () => camera.turn(0, TURN), ArrowDown: () => camera.turn(0, -TURN),
    "+": () => camera.zoom(0.8), "=": () => camera.zoom(0.8), "-": () => camera.zoom(1.25),
    a: () => camera.pan(40, 0, canvas.clientHeight), d: () => camera.pan(-40, 0, canvas.clientHeight),
    w: () => camera.pan(0, 40, canvas.clientHeight), s: () => camera.pan(0, -40, canvas.clientHeight),
    t: () => camera.look(-90, 90), f: () => camera.look(-90, 0), e: () => camera.look(0, 0),
    r: whole, Home: whole,
    " ": play, ",": () => show(state.latest - 1), ".": () => show(state.latest + 1),
    c: nextColouring, l: switchLight, "?": () => element("help").toggleAttribute("hidden"),
    Escape: () => element("help").setAttribute("hidden", ""),
  };
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || event.target.tagName === "SELECT") return;
    const layer = map.layers[Number(event.key) - 1];
    const act = keys[event.key] || keys[event.key.toLowerCase()];
    if (layer) element(`layer-${layer.name}`)?.click();
    else if (act) act();
    else return;
    event.preventDefault();
    redraw();
  });

  element("play").addEventListener("click", play);
  element("slider").addEventListener("input", (event) => { stop(); show(Number(event.target.value)); });
  element("light").addEventListener("click", switchLight);
  element("keys").addEventListener("click", keys["?"]);
  element("close").addEventListener("click", keys["?"]);
  // A button, box or choice that was made must not take the keys that follow.
  document.addEventListener("click", ({ target }) => { if (target.tagName !== "SELECT") document.activeElement.blur(); });
  element("colouring").addEventListener("change", ({ target }) => target.blur());

  document.title = `${map.title} · mls`;
  element("title").textContent = map.title;
  element("about").textContent =
    `${map.patches.ix.length.toLocaleString("en")} patches, cells of ${map.cell_size}, frame ${map.frame}`;
  element("slider").max = last;
  element("flight").hidden = !(last > 0);
  showLayers();
  showColourings();
  setLight(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  show(last);
  requestAnimationFrame(drawn);
  document.documentElement.dataset.ready = "yes";
}

main().catch((error) => {
  element("failure").textContent = `The map cannot be shown: ${error.message}.`;
  element("failure").hidden = false;
  throw error;
});
