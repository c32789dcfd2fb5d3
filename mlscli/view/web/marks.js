// What is drawn over the map and always seen: dots at places, a line between them, a text.

const FONT = "13px system-ui, sans-serif";

class Marks {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
  }

  clear() {
    const { canvas, pen } = this, ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    pen.scale(ratio, ratio);
    pen.font = FONT;
    [pen.lineWidth, pen.textAlign, pen.textBaseline] = [2, "center", "middle"];
  }

  // A way of pieces, each in its colour, and a ring around a place, if there is one.
  way(camera, places, colours, ring, { ink, paper }) {
    const { canvas, pen } = this;
    const at = (place) => camera.project(place, canvas.clientWidth, canvas.clientHeight);
    const pixels = places.map(at);
    for (const [wide, colourOf] of [[7, () => paper], [4, (n) => colours[n]]]) {
      [pen.lineWidth, pen.lineCap] = [wide, "round"];
      colours.forEach((_, n) => {
        if (!pixels[n] || !pixels[n + 1]) return;
        pen.strokeStyle = colourOf(n);
        pen.beginPath();
        pen.moveTo(...pixels[n]);
        pen.lineTo(...pixels[n + 1]);
        pen.stroke();
      });
    }
    const middle = ring && at(ring);
    if (!middle) return;
    [pen.lineWidth, pen.strokeStyle] = [2, ink];
    pen.beginPath();
    pen.arc(...middle, 9, 0, 2 * Math.PI);
    pen.stroke();
  }

  // Of one or two places; one behind the eye has no pixel, and no line leads to it.
  draw(camera, places, text, { ink, paper }) {
    const { canvas, pen } = this;
    const pixels = places.map(
      (place) => camera.project(place, canvas.clientWidth, canvas.clientHeight),
    ).filter(Boolean);
    pen.strokeStyle = pen.fillStyle = ink;
    pen.beginPath();
    for (const [x, y] of pixels) pen.lineTo(x, y);
    pen.stroke();
    for (const [x, y] of pixels) {
      pen.beginPath();
      pen.arc(x, y, 4, 0, 2 * Math.PI);
      pen.fill();
    }
    if (pixels.length < 2 || !text) return;
    const [x, y] = [0, 1].map((axis) => (pixels[0][axis] + pixels[1][axis]) / 2);
    writeOver(pen, text, x, y - 12, { ink, paper });
  }
}

// A text that can be read on any ground.
function writeOver(pen, text, x, y, { ink, paper }) {
  [pen.strokeStyle, pen.fillStyle, pen.lineWidth, pen.lineJoin] = [paper, ink, 4, "round"];
  pen.strokeText(text, x, y);
  pen.fillText(text, x, y);
}
