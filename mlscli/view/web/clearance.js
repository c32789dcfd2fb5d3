// Whether a craft fits along a polyline: what mlscli/queries/clearance.py computes, from what the
// page holds. The rules, and why they are so, stand there, in obstacles.py and in looked.py.

const FITS = 0;
const NEVER_SEEN = 1;
const DOUBTFUL = 2;
const BLOCKED = 3;
const VERDICTS = ["fits", "never seen", "doubtful", "does not fit"];
const MOST_CELLS = 1000, LEAST_REACH = 4, MOST_PIECES = 20_000;
const RUN = 6, PLATE = 2, SHARE = 0.5, MARGIN = 8, AROUND = 3;
const MEASURED = 0;

// The verdict on each piece of the way, how far it stays from obstacles, and the ends of the pieces
// with how far along they are; places and lengths in the map frame.
function clearanceOf(map, corners, width, height) {
  const side = map.cell_size, { places, along } = piecesOf(corners, side);
  const craft = { radius: width / 2, half: height / 2, rounding: 1e-9 * side };
  const reach = Math.max(width, LEAST_REACH * side);
  const verdicts = [], distances = [];
  for (let n = 0; n + 1 < places.length; n++) {
    const piece = [places[n], places[n + 1]];
    const { met, distance } = metOn(map, piece, craft, reach);
    const isSeen = map.seen && wasSeen(map, piece, craft);
    verdicts.push(met > NEVER_SEEN ? met : Math.max(met, isSeen ? FITS : NEVER_SEEN));
    distances.push(distance <= reach ? distance : Infinity);
  }
  return { places, along, verdicts, distances, reach };
}

// A polyline cut into pieces that are at most a cell long; a single place is a piece of no length.
function piecesOf(corners, side) {
  const places = [corners[0]], along = [0];
  let before = 0;
  for (let n = 1; n < corners.length; n++) {
    const step = add(corners[n], corners[n - 1], -1), length = Math.hypot(...step);
    if (!length) continue;
    const count = Math.max(1, Math.ceil(length / side - 1e-9));
    if (places.length + count > MOST_PIECES) throw new Error("the way is too long");
    for (let k = 1; k <= count; k++) {
      places.push(k < count ? add(corners[n - 1], step, k / count) : corners[n]);
      along.push(before + length * k / count);
    }
    before += length;
  }
  if (places.length === 1) return { places: [corners[0], corners[0]], along: [0, 0] };
  return { places, along };
}

// The first of cells in ascending order that does not come before one.
function firstCell({ ix, iy }, x, y) {
  let low = 0, high = ix.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (ix[middle] < x || (ix[middle] === x && iy[middle] < y)) low = middle + 1;
    else high = middle;
  }
  return low;
}

// --- obstacles ---

// What a craft meets on a piece: nothing, a guess (never seen), what may be there (doubtful), or
// what is; and its distance from what may be there, below 0 where it meets that.
function metOn(map, [a, b], craft, reach) {
  const side = map.cell_size, { patches } = map, found = { met: FITS, distance: Infinity };
  const low = Math.min(a[2], b[2]) - craft.half, high = Math.max(a[2], b[2]) + craft.half;
  const beside = craft.radius + reach;
  const cell = (axis, least) => Math.floor(
    (least ? Math.min(a[axis], b[axis]) - beside : Math.max(a[axis], b[axis]) + beside) / side,
  );
  const [firstX, lastX, firstY, lastY] = [cell(0, true), cell(0), cell(1, true), cell(1)];
  for (let ix = firstX; ix <= lastX; ix++) {
    let i = firstCell(patches, ix, firstY);
    for (; i < patches.ix.length && patches.ix[i] === ix && patches.iy[i] <= lastY; i++) {
      const patch = obstacle(map, i);
      const rise = Math.max(patch.low - high, low - patch.high);
      if (rise > reach) continue;
      const gap = toSquare(a, b, ix * side, patches.iy[i] * side, side) - craft.radius;
      const far = gap > 0 && rise > 0 ? Math.hypot(gap, rise) : Math.max(gap, rise);
      const meets = far < -craft.rounding;
      if (far >= found.distance && !meets) continue;
      const isThrough = seenThrough(map, patch, low, high);
      if (patch.isGuess && isThrough) continue;
      if (meets) {
        const isThere = !isThrough && meetsCore(a, b, patch, craft, side);
        found.met = Math.max(found.met, patch.isGuess ? NEVER_SEEN : isThere ? BLOCKED : DOUBTFUL);
      }
      found.distance = Math.min(found.distance, far);
    }
  }
  return found;
}

// A patch as all that it may be, and as what it is at least.
function obstacle(map, i) {
  const { ix, iy, height, depth, origin, below, over, bound } = map.patches, step = map.beyond;
  const top = height[i], foot = top - depth[i], middle = (top + foot) / 2, off = bound[i] * step;
  const isLevel = depth[i] === 0;
  return {
    ix: ix[i], iy: iy[i], isLevel, isGuess: map.origins[origin[i]] === "artificial",
    low: foot - below[i] * step - off, high: top + over[i] * step + off,
    coreLow: isLevel ? foot + off : Math.min(foot + off, middle),
    coreHigh: isLevel ? top - off : Math.max(top - off, middle),
  };
}

// Whether lines passed through all voxels of a patch, of those between two heights, if it lies there.
function seenThrough(map, patch, low, high) {
  if (!map.seen) return false;
  const half = map.cell_size / 2, isBetween = patch.low < high && patch.high > low;
  const bottom = isBetween ? Math.max(patch.low, low) : patch.low;
  const top = isBetween ? Math.min(patch.high, high) : patch.high;
  const first = Math.floor(bottom / half) - Number(patch.isLevel), last = Math.floor(top / half);
  return runsOver(map.seen, patch.ix, patch.iy).some(
    ([from, to]) => from <= first && last < to,
  );
}

// Whether a craft meets the core of a patch; one thinner than a cell counts as wide as a cell.
function meetsCore(a, b, patch, craft, side) {
  const radius = Math.max(craft.radius - craft.rounding, side / 2 + craft.rounding);
  const [begin, end] = within(a, b, (patch.ix + 0.5) * side, (patch.iy + 0.5) * side, radius);
  const lowest = patch.coreLow - craft.half, highest = patch.coreHigh + craft.half;
  if (lowest > highest) return false;
  const [rises, ends] = clipped(a[2], b[2] - a[2], lowest, highest);
  return Math.max(begin, rises) <= Math.min(end, ends);
}

// --- space that was seen ---

// The free voxels above a cell, as runs from one up to before another.
function runsOver(seen, ix, iy) {
  seen.start ??= seen.count.reduce((starts, count) => {
    starts.push(starts.at(-1) + count);
    return starts;
  }, [0]);
  const cell = firstCell(seen, ix, iy);
  if (seen.ix[cell] !== ix || seen.iy[cell] !== iy) return [];
  const runs = [];
  for (let run = seen.start[cell]; run < seen.start[cell + 1]; run++) {
    runs.push([seen.low[run], seen.low[run] + seen.length[run]]);
  }
  return runs;
}

// Whether the space of a craft on a piece was seen: nothing blank that is as large as a run or a
// plate reaches into it, and lines passed through enough of it.
function wasSeen(map, [a, b], craft) {
  const side = map.cell_size, half = side / 2;
  const least = (axis) => Math.floor((Math.min(a[axis], b[axis]) - craft.radius) / side) - AROUND;
  const most = (axis) => Math.floor((Math.max(a[axis], b[axis]) + craft.radius) / side) + AROUND;
  const [firstX, firstY] = [least(0), least(1)];
  const [rows, columns] = [most(0) - firstX + 1, most(1) - firstY + 1];
  const lowest = Math.floor((Math.min(a[2], b[2]) - craft.half + craft.rounding) / half);
  const highest = Math.max(
    lowest, Math.ceil((Math.max(a[2], b[2]) + craft.half - craft.rounding) / half) - 1,
  );
  const bottom = lowest - MARGIN, deep = highest + MARGIN - bottom + 1;
  const at = (i, j) => (i * columns + j) * deep;
  const fill = (voxels, i, j, from, to) => {
    const [first, last] = [Math.max(from - bottom, 0), Math.min(to - bottom, deep)];
    if (first < last) voxels.fill(1, at(i, j) + first, at(i, j) + last);
  };
  const open = new Uint8Array(rows * columns * deep), explained = new Uint8Array(open.length);
  const inside = new Uint8Array(rows * columns);
  for (let i = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++) {
      const x = firstX + i, y = firstY + j;
      for (const [from, to] of runsOver(map.seen, x, y)) fill(open, i, j, from, to);
      for (const [from, to] of measuredOver(map, x, y, half)) {
        for (let k = Math.max(i - 1, 0); k <= Math.min(i + 1, rows - 1); k++) {
          for (let m = Math.max(j - 1, 0); m <= Math.min(j + 1, columns - 1); m++) {
            fill(explained, k, m, from - 2, to + 2);
          }
        }
      }
      const isOfCraft = i >= AROUND && i < rows - AROUND && j >= AROUND && j < columns - AROUND;
      const gap = isOfCraft ? toSquare(a, b, x * side, y * side, side) - craft.radius : 0;
      inside[i * columns + j] = Number(gap < -craft.rounding);
    }
  }
  let opened = 0, voxels = 0;
  for (let column = 0; column < inside.length; column++) {
    for (let k = MARGIN; inside[column] && k < deep - MARGIN; k++) {
      opened += open[column * deep + k];
      voxels += 1;
    }
  }
  if (!voxels || opened < SHARE * voxels) return false;
  const isBlank = (column, first, length) => {
    for (let k = first; k < first + length; k++) {
      if (open[column * deep + k] || explained[column * deep + k]) return false;
    }
    return true;
  };
  return !hasBlank(inside, rows, columns, deep, isBlank);
}

// Whether a run or a plate of blank voxels reaches into the columns of the craft.
function hasBlank(inside, rows, columns, deep, isBlank) {
  const last = deep - MARGIN - 1;
  for (let i = 2; i < rows - 2; i++) {
    for (let j = 2; j < columns - 2; j++) {
      const around = [-1, 0, 1].flatMap(
        (k) => [-1, 0, 1].map((m) => (i + k) * columns + j + m),
      );
      for (let k = MARGIN - RUN + 1; inside[i * columns + j] && k <= last; k++) {
        if (isBlank(i * columns + j, k, RUN)) return true;
      }
      if (!around.some((column) => inside[column])) continue;
      for (let k = MARGIN - PLATE + 1; k <= last; k++) {
        if (around.every((column) => isBlank(column, k, PLATE))) return true;
      }
    }
  }
  return false;
}

// The voxels that measured patches of a cell reach into, each from one up to before another.
function measuredOver(map, ix, iy, half) {
  const { patches } = map, reached = [];
  for (let i = firstCell(patches, ix, iy); patches.ix[i] === ix && patches.iy[i] === iy; i++) {
    if (patches.origin[i] !== MEASURED) continue;
    const { low, high } = obstacle(map, i);
    reached.push([Math.floor(low / half), Math.floor(high / half) + 1]);
  }
  return reached;
}

// --- distances in the plane; see mlscli/queries/planes.py ---

function toSquare(a, b, x, y, side) {
  const [beginX, endX] = clipped(a[0], b[0] - a[0], x, x + side);
  const [beginY, endY] = clipped(a[1], b[1] - a[1], y, y + side);
  if (Math.max(beginX, beginY) <= Math.min(endX, endY)) return 0;
  const fromSquare = ([px, py]) => Math.hypot(
    Math.max(x - px, px - x - side, 0), Math.max(y - py, py - y - side, 0),
  );
  let least = Math.min(fromSquare(a), fromSquare(b));
  for (const [cx, cy] of [[x, y], [x + side, y], [x, y + side], [x + side, y + side]]) {
    least = Math.min(least, toPlace(a, b, cx, cy));
  }
  return least;
}

function toPlace(a, b, x, y) {
  const dx = b[0] - a[0], dy = b[1] - a[1], square = dx * dx + dy * dy;
  const along = square > 0 ? ((x - a[0]) * dx + (y - a[1]) * dy) / square : 0;
  const share = Math.min(Math.max(along, 0), 1);
  return Math.hypot(a[0] + share * dx - x, a[1] + share * dy - y);
}

// From where to where a number that grows evenly lies in an interval, as shares from 0 to 1.
function clipped(start, step, low, high) {
  if (step === 0) return low <= start && start <= high ? [0, 1] : [1, 0];
  const one = (low - start) / step, other = (high - start) / step;
  return [Math.max(Math.min(one, other), 0), Math.min(Math.max(one, other), 1)];
}

// From where to where a piece lies within a radius of a place, as shares from 0 to 1.
function within(a, b, x, y, radius) {
  const dx = b[0] - a[0], dy = b[1] - a[1], fx = a[0] - x, fy = a[1] - y;
  const square = dx * dx + dy * dy, half = fx * dx + fy * dy;
  const rest = fx * fx + fy * fy - radius * radius;
  if (square === 0) return rest < 0 ? [0, 1] : [1, 0];
  const under = half * half - square * rest;
  if (under <= 0) return [1, 0];
  const root = Math.sqrt(under);
  return [Math.max((-half - root) / square, 0), Math.min((root - half) / square, 1)];
}

// --- what is told of it ---

// The polyline as parts with one verdict each: from where to where along it.
function stretchesOf({ verdicts, along }) {
  const stretches = [];
  verdicts.forEach((verdict, n) => {
    const open = stretches.at(-1);
    if (open?.verdict === verdict) open.end = along[n + 1];
    else stretches.push({ verdict, begin: along[n], end: along[n + 1] });
  });
  return stretches;
}

// The piece on which the craft comes nearest to an obstacle; of several the middle of the first
// that follow one another.
function narrowestOf({ distances }) {
  const least = distances.reduce((low, each) => Math.min(low, each), Infinity);
  const first = distances.indexOf(least);
  let last = first;
  while (distances[last + 1] === least) last += 1;
  return Math.floor((first + last) / 2);
}
