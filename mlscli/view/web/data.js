// The data of the page: a header, and arrays described by rows; see mlscli/view/page.py.

async function load() {
  const header = JSON.parse(document.getElementById("header").textContent);
  const bytes = bytesOf(document.getElementById("data").textContent);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();

  const types = { Int32Array, Uint32Array, Uint8Array, Float32Array };
  const array = ({ type, begin, length, columns, fan, step }, Numbers = Float32Array) => {
    const values = new types[type](buffer, begin, length);
    if (fan) unfold(values, columns);
    else if (columns) for (let i = columns; i < length; i++) values[i] += values[i - columns];
    if (!step) return values;
    const numbers = new Numbers(length);
    for (let i = 0; i < length; i++) numbers[i] = values[i] * step;
    return numbers;
  };
  const arrays = (rows, Numbers) =>
    Object.fromEntries(Object.entries(rows).map(([name, row]) => [name, array(row, Numbers)]));

  for (const [name, rows] of Object.entries(header.vertices)) header.vertices[name] = arrays(rows);
  for (const layer of header.layers) {
    layer.elements = new Uint32Array(array(layer.elements));
    layer.when = array(layer.when);
  }
  for (const way of header.colourings) way.colour = array(way.colour);
  header.patches = arrays(header.patches, Float64Array);
  if (header.seen) header.seen = arrays(header.seen);
  header.vertices.patches.position = placesOf(header);
  const { patches, origin } = header;
  patches.height = Float64Array.from(patches.height, (height) => height + origin[2]);
  return header;
}

// The bytes that base64 stands for.
function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text), bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

// Differences become the numbers that they are of: a first corner's from the one before, the
// others' from the first.
function unfold(values, columns) {
  for (let i = 0; i < values.length; i += columns) {
    if (i) values[i] += values[i - columns];
    for (let corner = 1; corner < columns; corner++) values[i + corner] += values[i];
  }
}

// Where patches are drawn as points, relative to the map's origin: in the middle of their cells, at
// their heights; and after them the lower ends of the upright ones.
function placesOf({ patches: { ix, iy, height, depth }, cell_size: side, origin: [x, y] }) {
  let count = ix.length;
  for (let i = 0; i < ix.length; i++) count += depth[i] > 0;
  const places = new Float32Array(3 * count);
  const put = (at, i, z) => {
    places[at] = (ix[i] + 0.5) * side - x;
    places[at + 1] = (iy[i] + 0.5) * side - y;
    places[at + 2] = z;
  };
  let foot = 3 * ix.length;
  for (let i = 0; i < ix.length; i++) {
    put(3 * i, i, height[i]);
    if (!(depth[i] > 0)) continue;
    put(foot, i, height[i] - depth[i]);
    foot += 3;
  }
  return places;
}

// How many of ascending numbers are at most a limit.
function upTo(numbers, limit) {
  let low = 0, high = numbers.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= limit) low = middle + 1;
    else high = middle;
  }
  return low;
}

// The patch at a place (x, y, z in the map frame): of its cell the nearest, or -1.
function patchAt(map, x, y, z) {
  const { ix, iy, height, depth } = map.patches;
  const cellX = Math.floor(x / map.cell_size), cellY = Math.floor(y / map.cell_size);
  const before = (i) => ix[i] < cellX || (ix[i] === cellX && iy[i] < cellY);
  let low = 0, high = ix.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (before(middle)) low = middle + 1;
    else high = middle;
  }
  let nearest = -1, least = Infinity;
  for (let i = low; i < ix.length && ix[i] === cellX && iy[i] === cellY; i++) {
    const distance = Math.max(z - height[i], height[i] - depth[i] - z, 0);
    if (distance < least) [nearest, least] = [i, distance];
  }
  return nearest;
}
