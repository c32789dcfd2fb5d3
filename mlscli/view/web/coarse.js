// The map in fewer elements, for a view that moves where drawing is slow. Vertices in the same box
// become the first of them, and triangles that keep three corners stay (vertex clustering,
// Rossignac and Borrel 1993, DOI 10.1007/978-3-642-78114-8_29); of lines and points every so manieth.

const FEW = 50_000, MOST_TRIES = 4;

// For each layer the elements and when they appear; the layer itself where it has few already.
function coarser(map) {
  const isFaces = ({ corners }) => corners === 3;
  const count = (layers) => layers.reduce((sum, { when }) => sum + when.length, 0);
  const faces = map.layers.filter(isFaces);
  let step = 1, coarse = faces;
  for (let tries = 0; tries < MOST_TRIES && count(coarse) > FEW; tries++) {
    step = Math.ceil(step * Math.sqrt(count(coarse) / FEW));
    const firsts = firstInBox(map.vertices.mesh.position, step * map.cell_size);
    coarse = faces.map((layer) => collapsed(layer, firsts));
  }
  return map.layers.map((layer) => (isFaces(layer) ? coarse.shift() : thinned(layer)));
}

// For each vertex the first that lies in the same box; boxes are half as high as they are wide, so
// that levels close to each other stay apart.
function firstInBox(position, width) {
  const firsts = new Uint32Array(position.length / 3), known = new Map();
  for (let i = 0; i < firsts.length; i++) {
    const [x, y, z] = position.subarray(3 * i, 3 * i + 3);
    const box = (Math.floor(x / width) * 2 ** 17 + Math.floor(y / width)) * 2 ** 17
      + Math.floor(2 * z / width);
    if (!known.has(box)) known.set(box, i);
    firsts[i] = known.get(box);
  }
  return firsts;
}

function collapsed({ elements, when }, firsts) {
  const kept = { elements: [], when: [] };
  for (let i = 0; i < when.length; i++) {
    const [a, b, c] = [0, 1, 2].map((corner) => firsts[elements[3 * i + corner]]);
    if (a === b || b === c || c === a) continue;
    kept.elements.push(a, b, c);
    kept.when.push(when[i]);
  }
  return { elements: new Uint32Array(kept.elements), when: kept.when };
}

function thinned({ elements, when, corners }) {
  const every = Math.ceil(when.length / FEW) || 1;
  const isKept = (_, i) => Math.floor(i / corners) % every === 0;
  return { elements: elements.filter(isKept), when: when.filter((_, i) => i % every === 0) };
}
