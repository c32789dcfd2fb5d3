// The data of the page: a header, and arrays described by rows [type, begin, length, columns].

async function load() {
  const header = JSON.parse(document.getElementById("header").textContent);
  const text = document.getElementById("data").textContent;
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const buffer = await new Response(stream).arrayBuffer();

  const types = { Int32Array, Uint32Array, Uint8Array, Float32Array, Float64Array };
  const array = ([type, begin, length, columns]) => {
    const values = new types[type](buffer, begin, length);
    // Differences, column by column, become the numbers that they are of.
    if (columns) for (let i = columns; i < length; i++) values[i] += values[i - columns];
    return values;
  };
  const arrays = (rows) =>
    Object.fromEntries(Object.entries(rows).map(([name, row]) => [name, array(row)]));

  for (const [name, rows] of Object.entries(header.vertices)) header.vertices[name] = arrays(rows);
  for (const layer of header.layers) {
    layer.elements = new Uint32Array(array(layer.elements));
    layer.when = array(layer.when);
  }
  for (const way of header.colourings) way.colour = array(way.colour);
  header.patches = arrays(header.patches);
  return header;
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
