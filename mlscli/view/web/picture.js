// The picture as it stands, with what is marked on it, its scale and its name, as a file.

const KEPT = 60_000; // milliseconds that the browser has to write it

async function savePicture(canvases, { title, scale, ink, paper }) {
  const [{ width, height, clientWidth }] = canvases, ratio = width / clientWidth;
  const sheet = Object.assign(document.createElement("canvas"), { width, height });
  const pen = sheet.getContext("2d"), foot = height / ratio - 16;
  for (const canvas of canvases) pen.drawImage(canvas, 0, 0, width, height);
  pen.scale(ratio, ratio);
  [pen.font, pen.textBaseline, pen.fillStyle] = [FONT, "middle", ink];
  pen.fillRect(14, foot - 1, scale.pixels, 3);
  writeOver(pen, scale.text, 22 + scale.pixels, foot, { ink, paper });
  writeOver(pen, title, 14, 20, { ink, paper });
  const file = await new Promise((done) => { sheet.toBlob(done, "image/png"); });
  const href = URL.createObjectURL(file);
  Object.assign(document.createElement("a"), { href, download: `${title}.png` }).click();
  setTimeout(() => URL.revokeObjectURL(href), KEPT);
}
