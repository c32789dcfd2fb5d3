// What frames the picture: the axes, and a bar as long as the length beside it.

function drawAxes(camera) {
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

// How many pixels are how long: a round length, of at most 160 pixels.
function scaleOf(camera, height) {
  const pixel = camera.pixel(height), widest = 160 * pixel;
  const power = 10 ** Math.floor(Math.log10(widest));
  const length = [5, 2, 1].find((factor) => factor * power <= widest) * power;
  return { pixels: length / pixel, text: `${Number(length.toPrecision(1))}` };
}

function drawScale({ pixels, text }) {
  element("bar").style.width = `${pixels}px`;
  element("length").textContent = text;
}
