// Mouse, touch and keys.

const TURN = Math.PI / 36;
const takesKeys = ({ tagName, type }) => tagName === "SELECT" || type === "number";
const STILL = 4; // pixels that a finger may move in a click

// Turn, move and zoom the view by hand; `picked` tells the place under the cursor, `clicked` is
// called where a finger went down and up again without having moved.
function pointersOf({ canvas, camera, state, redraw, ask }, picked, clicked) {
  const fingers = new Map();
  let pressed = null;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
    pressed = fingers.size === 1 && event.button === 0 ? event : null;
  });
  canvas.addEventListener("pointerup", (event) => {
    fingers.delete(event.pointerId);
    state.cursor = [event.offsetX, event.offsetY];
    if (pressed) clicked();
    pressed = null;
  });
  canvas.addEventListener("pointercancel", (event) => {
    fingers.delete(event.pointerId);
    pressed = null;
  });
  canvas.addEventListener("pointerleave", () => { state.cursor = null; ask(); });
  canvas.addEventListener("pointermove", (event) => {
    const before = fingers.get(event.pointerId);
    state.cursor = fingers.size ? null : [event.offsetX, event.offsetY];
    if (pressed && apart(event, pressed) > STILL) pressed = null;
    if (before && !pressed) {
      const right = event.clientX - before.clientX, down = event.clientY - before.clientY;
      if (fingers.size === 2) pinch(event, before, right / 2, down / 2);
      else if (event.shiftKey || event.buttons & 6) camera.pan(right, down, canvas.clientHeight);
      else camera.turn(-right / 200, down / 200);
      fingers.set(event.pointerId, event);
      redraw();
    }
    ask();
  });

  const apart = (one, other) => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY);

  function pinch(event, before, right, down) {
    const [other] = [...fingers.values()].filter((each) => each.pointerId !== event.pointerId);
    camera.zoom(apart(before, other) / Math.max(apart(event, other), 1));
    camera.pan(right, down, canvas.clientHeight);
  }

  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    state.cursor = [event.offsetX, event.offsetY];
    const lines = event.deltaMode === 1 ? 30 : 1;
    const step = Math.max(-200, Math.min(200, event.deltaY * lines));
    camera.zoom(1.0015 ** step, picked(state.detail) || camera.target);
    redraw();
  }, { passive: false });
  canvas.addEventListener("dblclick", () => {
    camera.target = picked() || camera.target;
    redraw();
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
}

function keysOf({ map, canvas, camera, redraw }, { whole, flight, layers, ...acts }) {
  const pan = (right, down) => camera.pan(right, down, canvas.clientHeight);
  const keys = {
    ArrowLeft: () => camera.turn(-TURN, 0), ArrowRight: () => camera.turn(TURN, 0),
    ArrowUp: () => camera.turn(0, TURN), ArrowDown: () => camera.turn(0, -TURN),
    "+": () => camera.zoom(0.8), "=": () => camera.zoom(0.8), "-": () => camera.zoom(1.25),
    a: () => pan(40, 0), d: () => pan(-40, 0), w: () => pan(0, 40), s: () => pan(0, -40),
    t: () => camera.look(-90, 90), f: () => camera.look(-90, 0), e: () => camera.look(0, 0),
    r: whole, Home: whole,
    " ": flight.play, ",": () => flight.step(-1), ".": () => flight.step(1),
    ...acts,
  };
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || takesKeys(event.target)) return;
    const layer = map.layers[Number(event.key) - 1];
    const act = keys[event.key] || keys[event.key.toLowerCase()];
    if (layer) layers.click(layer);
    else if (act) act();
    else return;
    event.preventDefault();
    redraw();
  });
  // A button, box or choice that was made must not take the keys that follow.
  document.addEventListener("click", ({ target }) => {
    if (!takesKeys(target)) document.activeElement.blur();
  });
}
