// The flight: the slider of keyframes, and playing it.

const PLAYING = 12; // seconds that the whole flight takes

function flightOf({ map, state, redraw }) {
  const last = Math.max(map.keyframes - 1, 0);
  let timer = null;
  element("slider").max = last;
  element("flight").hidden = !(last > 0);

  function show(keyframe) {
    state.latest = Math.max(0, Math.min(last, Math.round(keyframe)));
    element("slider").value = state.latest;
    const time = map.times ? `, ${map.times[state.latest].toFixed(1)} s` : "";
    // Counted from 1, as by every command.
    element("keyframe").textContent = `keyframe ${state.latest + 1} of ${last + 1}${time}`;
    redraw();
  }

  function stop() {
    clearInterval(timer);
    timer = null;
    element("play").textContent = "▶";
  }

  function play() {
    if (timer !== null) return stop();
    let at = state.latest === last ? 0 : state.latest;
    let before = performance.now();
    element("play").textContent = "❚❚";
    show(at);
    timer = setInterval(() => {
      const now = performance.now();
      at += last * (now - before) / (1000 * PLAYING);
      before = now;
      show(at);
      if (at >= last) stop();
    }, 40);
  }

  element("play").addEventListener("click", play);
  element("slider").addEventListener("input", ({ target }) => { stop(); show(Number(target.value)); });
  show(last);
  return { last, show, play, step: (keyframes) => show(state.latest + keyframes) };
}
