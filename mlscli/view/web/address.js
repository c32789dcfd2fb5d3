// The view, written behind the # of the page's address, so that it can be kept and sent.

function addressOf({ map, camera, state, number }, parts) {
  const { flight, layers, colouring, cutting, ruler, craft } = parts;
  let written = "";

  return {
    write() {
      const degrees = [camera.yaw, camera.pitch].map((angle) => (angle * 180 / Math.PI).toFixed(1));
      const colour = colouring.chosen();
      const address = toAddress({
        view: [...degrees, ...[camera.distance, ...add(camera.target, map.origin)].map(number)],
        keyframe: state.latest < flight.last ? [state.latest + 1] : null,
        layers: layers.shown(),
        colour: colour && [colour],
        cut: cutting.words(),
        measure: ruler.places(),
        fit: craft.words(),
      });
      if (address !== written) history.replaceState(null, "", `#${address}`);
      written = address;
    },

    read() {
      const said = fromAddress(location.hash), local = (place) => add(place, map.origin, -1);
      const view = numbersOf(said.get("view"), 6);
      if (view && view[2] > 0) {
        camera.look(view[0], view[1]);
        [camera.distance, camera.target] = [view[2], local(view.slice(3))];
      }
      const keyframe = numbersOf(said.get("keyframe"), 1);
      flight.show(keyframe ? keyframe[0] - 1 : flight.last);
      layers.show(said.get("layers"));
      colouring.choose(said.get("colour")?.[0] ?? map.colourings[0].name);
      cutting.take(said.get("cut") ?? [""]);
      const ends = numbersOf(said.get("measure"), 6);
      craft.read(said.get("fit"));
      ruler.set(Boolean(ends), ends ? [local(ends.slice(0, 3)), local(ends.slice(3))] : []);
    },
  };
}

// From names and values to text; a value is a list of numbers or words, and null is left out.
function toAddress(values) {
  const known = Object.entries(values).filter(([, value]) => value !== null);
  return known.map(([name, value]) => `${name}=${value.map(encodeURIComponent).join(",")}`).join("&");
}

// The lists of words by name. It may have been written by anybody.
function fromAddress(text) {
  const parts = text.replace(/^#/, "").split("&").map((part) => part.split("="));
  const word = (written) => {
    try {
      return decodeURIComponent(written);
    } catch {
      return "";
    }
  };
  const pairs = parts.filter((part) => part.length === 2);
  return new Map(pairs.map(([name, value]) => [name, value.split(",").map(word)]));
}

// So many numbers of an address; null: it has others.
function numbersOf(words, count) {
  const numbers = words?.map((word) => (word.trim() ? Number(word) : NaN));
  return numbers?.length === count && numbers.every(Number.isFinite) ? numbers : null;
}
