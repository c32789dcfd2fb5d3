// The map in fewer elements, for a view that moves where drawing is slow. Vertices in the same box
// become the first of them, and elements that keep their corners stay (vertex clustering, Rossignac
// and Borrel 1993, DOI 10.1007/978-3-642-78114-8_29). Where a box loses all its triangles, one stays
// as it was. Of lines and points beside the mesh every so manieth is left.

const FEW = 50_000, MOST_TRIES = 4;
const ARTIFICIAL = 2;

// For each layer the elements and when they appear; the layer itself where it has few already.
function coarser(map) {
  const isOfMesh = ({ vertices }) => vertices === "mesh";
  const count = (layers) => layers.reduce((sum, { when }) => sum + when.length, 0);
  const fine = map.layers.filter(isOfMesh);
  let step = 1, coarse = fine;
  for (let tries = 0; tries < MOST_TRIES && count(coarse) > FEW; tries++) {
    step = Math.ceil(step * Math.sqrt(count(coarse) / FEW));
    const firsts = firstInBox(map, step * map.cell_size);
    const isDrawn = new Uint8Array(firsts.length);
    for (const layer of fine) if (layer.corners === 3) markDrawn(layer, firsts, isDrawn);
    coarse = fine.map((layer) => collapsed(layer, firsts, isDrawn));
  }
  return map.layers.map((layer) => (isOfMesh(layer) ? coarse.shift() : thinned(layer)));
}

// For each vertex the first in the same box. Boxes are half as high as they are wide, so that levels
// close to each other stay apart; what is artificial stays apart from what is not, and so does what
// belongs to no patch, as the route.
function firstInBox({ vertices: { mesh: { position, patch } }, patches: { origin } }, width) {
  const firsts = new Uint32Array(position.length / 3), known = new Map();
  const sizes = [width, width, width / 2], least = [0, 1, 2].map((axis) => {
    let low = Infinity;
    for (let i = axis; i < position.length; i += 3) low = Math.min(low, position[i]);
    return Math.floor(low / sizes[axis]);
  });
  const spans = [0, 1, 2].map((axis) => {
    let high = -Infinity;
    for (let i = axis; i < position.length; i += 3) high = Math.max(high, position[i]);
    return Math.floor(high / sizes[axis]) - least[axis] + 1;
  });
  for (let i = 0; i < firsts.length; i++) {
    let box = patch[i] < 0 ? 2 : Number(origin[patch[i]] === ARTIFICIAL);
    let stride = 3;
    for (let axis = 0; axis < 3; axis++) {
      box += stride * (Math.floor(position[3 * i + axis] / sizes[axis]) - least[axis]);
      stride *= spans[axis];
    }
    if (!known.has(box)) known.set(box, i);
    firsts[i] = known.get(box);
  }
  return firsts;
}

// Whether corners of an element become the same vertex.
function isCollapsed({ elements, corners }, at, firsts) {
  for (let i = at; i < at + corners; i++) {
    for (let j = at; j < i; j++) if (firsts[elements[i]] === firsts[elements[j]]) return true;
  }
  return false;
}

function markDrawn(layer, firsts, isDrawn) {
  const { elements, corners } = layer;
  for (let at = 0; at < elements.length; at += corners) {
    if (isCollapsed(layer, at, firsts)) continue;
    for (let i = at; i < at + corners; i++) isDrawn[firsts[elements[i]]] = 1;
  }
}

function collapsed(layer, firsts, isDrawn) {
  const { elements, when, corners } = layer, kept = { elements: [], when: [] };
  for (let at = 0; at < elements.length; at += corners) {
    const isLost = isCollapsed(layer, at, firsts), first = firsts[elements[at]];
    if (isLost && (corners < 3 || isDrawn[first])) continue;
    if (isLost) isDrawn[first] = 1;
    for (let i = at; i < at + corners; i++) {
      kept.elements.push(isLost ? elements[i] : firsts[elements[i]]);
    }
    kept.when.push(when[at / corners]);
  }
  return { elements: new Uint32Array(kept.elements), when: kept.when };
}

function thinned({ elements, when, corners }) {
  const every = Math.ceil(when.length / FEW) || 1;
  const isKept = (_, i) => Math.floor(i / corners) % every === 0;
  return { elements: elements.filter(isKept), when: when.filter((_, i) => i % every === 0) };
}
