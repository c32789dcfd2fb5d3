// Draws the layers with WebGL 2, and tells the place that a pixel shows.

const VERTEX_SHADER = `#version 300 es
uniform mat4 view;
uniform float pointSize;
uniform vec2 shift;
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 colour;
out vec3 place;
out vec3 tint;
void main() {
  place = position;
  tint = colour;
  gl_Position = view * vec4(position, 1.0);
  gl_Position.xy += shift * gl_Position.w;
  gl_PointSize = pointSize;
}`;

// Faces are shaded by their own slope, from whichever side they are seen.
const COLOUR_SHADER = `#version 300 es
precision highp float;
uniform bool isShaded;
uniform vec3 light;
uniform vec4 cut;
in vec3 place;
in vec3 tint;
out vec4 pixel;
void main() {
  if (dot(place, cut.xyz) > cut.w) discard;
  vec3 face = cross(dFdx(place), dFdy(place));
  float size = length(face);
  float shade = isShaded && size > 0.0 ? 0.5 + 0.5 * abs(dot(face / size, light)) : 1.0;
  pixel = vec4(tint * shade, 1.0);
}`;

// The place itself, its bits as they are.
const PLACE_SHADER = `#version 300 es
precision highp float;
precision highp int;
uniform vec4 cut;
in vec3 place;
in vec3 tint;
out uvec4 pixel;
void main() {
  if (dot(place, cut.xyz) > cut.w) discard;
  pixel = uvec4(floatBitsToUint(place), tint.r >= 0.0 ? 1u : 0u);
}`;

// WebGL draws lines one pixel wide; those of a route are drawn several times, side by side.
const ONCE = [[0, 0]];
const WIDE = [[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]];

// What is drawn over the map and is no part of it.
const NO_PLACES = ["route", "track"];

const LIGHT = [0.35, -0.45, 0.82];

class Scene {
  constructor(canvas, map) {
    this.canvas = canvas;
    this.map = map;
    this.cut = new Cut(map);
    // Edges are smoothed by `draw`, where there is time for it.
    this.gl = canvas.getContext("webgl2", { antialias: false });
    if (!this.gl) throw new Error("this browser has no WebGL 2, which the map is drawn with");
    const gl = this.gl;
    this.colour = this.program(COLOUR_SHADER);
    this.place = this.program(PLACE_SHADER);
    const vertices = Object.fromEntries(
      Object.entries(map.vertices).map(([name, arrays]) => [name, {
        position: this.buffer(gl.ARRAY_BUFFER, arrays.position),
        colour: this.buffer(gl.ARRAY_BUFFER, arrays.colour),
      }]),
    );
    this.vertices = vertices;
    const modes = { 1: gl.POINTS, 2: gl.LINES, 3: gl.TRIANGLES };
    for (const layer of map.layers) {
      layer.mode = modes[layer.corners];
      layer.attributes = this.attributes(vertices[layer.vertices], layer.elements);
    }
    this.picked = this.target();
    this.store(this.picked, 1, 1, 0, gl.RGBA32UI);
    this.smooth = this.target();
    gl.enable(gl.DEPTH_TEST);
    gl.depthFunc(gl.LEQUAL);
    // Lines and points on a face lie before it.
    gl.enable(gl.POLYGON_OFFSET_FILL);
    gl.polygonOffset(1, 2);
  }

  program(fragmentShader) {
    const { gl } = this, program = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, fragmentShader],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new Error(`the graphics driver refuses a shader: ${gl.getProgramInfoLog(program)}`);
    }
    const uniforms = ["view", "pointSize", "shift", "isShaded", "light", "cut"];
    const places = uniforms.map((name) => [name, gl.getUniformLocation(program, name)]);
    return { program, ...Object.fromEntries(places) };
  }

  buffer(target, array) {
    const { gl } = this, buffer = gl.createBuffer();
    gl.bindBuffer(target, buffer);
    gl.bufferData(target, array, gl.STATIC_DRAW);
    return buffer;
  }

  // Gives what belongs to patches the colours of these; null: what is of the map by height.
  paint(colours) {
    const { gl } = this;
    for (const [name, { colour, patch }] of Object.entries(this.map.vertices)) {
      if (!patch) continue;
      const shown = colours ? colour.slice() : colour, painted = colours ? patch.length : 0;
      for (let i = 0; i < painted; i++) {
        const from = 3 * patch[i], to = 3 * i;
        if (from < 0) continue;
        for (let channel = 0; channel < 3; channel++) shown[to + channel] = colours[from + channel];
      }
      gl.bindBuffer(gl.ARRAY_BUFFER, this.vertices[name].colour);
      gl.bufferData(gl.ARRAY_BUFFER, shown, gl.STATIC_DRAW);
    }
  }

  // The layers, whole or coarse; these are made when they are first needed.
  layers(detail) {
    const { layers } = this.map;
    if (detail !== "coarse") return layers;
    this.coarse ??= coarser(this.map).map(({ elements, when }, i) => (
      { when, attributes: this.attributes(this.vertices[layers[i].vertices], elements) }
    ));
    return layers.map((layer, i) => ({ ...layer, ...this.coarse[i] }));
  }

  attributes({ position, colour }, elements) {
    const { gl } = this, attributes = gl.createVertexArray();
    gl.bindVertexArray(attributes);
    gl.bindBuffer(gl.ARRAY_BUFFER, position);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.bindBuffer(gl.ARRAY_BUFFER, colour);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribPointer(1, 3, gl.UNSIGNED_BYTE, true, 0, 0);
    this.buffer(gl.ELEMENT_ARRAY_BUFFER, elements);
    gl.bindVertexArray(null);
    return attributes;
  }

  // Something else to draw on than the canvas: a colour and a depth for each pixel.
  target() {
    const { gl } = this, target = { frame: gl.createFramebuffer() };
    gl.bindFramebuffer(gl.FRAMEBUFFER, target.frame);
    for (const [name, attachment] of [
      ["colour", gl.COLOR_ATTACHMENT0], ["depth", gl.DEPTH_ATTACHMENT],
    ]) {
      target[name] = gl.createRenderbuffer();
      gl.bindRenderbuffer(gl.RENDERBUFFER, target[name]);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, attachment, gl.RENDERBUFFER, target[name]);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return target;
  }

  store(target, width, height, samples, format) {
    const { gl } = this;
    if (target.width === width && target.height === height) return;
    Object.assign(target, { width, height });
    for (const [part, kind] of [["colour", format], ["depth", gl.DEPTH_COMPONENT24]]) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, target[part]);
      gl.renderbufferStorageMultisample(gl.RENDERBUFFER, samples, kind, width, height);
    }
  }

  // Smooth edges take several times as long where the processor draws.
  draw(camera, background, latest, detail) {
    const { gl, canvas } = this, isSmooth = detail === "smooth";
    const ratio = window.devicePixelRatio || 1;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) {
      [canvas.width, canvas.height] = [width, height];
    }
    if (isSmooth) {
      this.store(this.smooth, width, height, Math.min(4, gl.getParameter(gl.MAX_SAMPLES)), gl.RGBA8);
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.smooth.frame);
    }
    gl.viewport(0, 0, width, height);
    gl.clearColor(...background, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    this.elements(this.colour, this.layers(detail), camera.matrix(width, height), latest, ratio);
    if (!isSmooth) return;
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    const whole = [0, 0, width, height];
    gl.blitFramebuffer(...whole, ...whole, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  // The place shown at a pixel, counted from the top left; null where nothing is.
  pick(camera, x, y, latest, detail) {
    const { gl, canvas } = this, { width, height } = canvas, ratio = window.devicePixelRatio || 1;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.picked.frame);
    // The picture is as large as ever, and shifted until that pixel is the one there is.
    gl.viewport(-Math.floor(x * ratio), 1 - height + Math.floor(y * ratio), width, height);
    gl.clearBufferuiv(gl.COLOR, 0, new Uint32Array(4));
    gl.clearBufferfi(gl.DEPTH_STENCIL, 0, 1, 0);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    const solid = this.layers(detail).filter(({ name }) => !NO_PLACES.includes(name));
    this.elements(this.place, solid, camera.matrix(width, height), latest, ratio);
    const pixel = new Uint32Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA_INTEGER, gl.UNSIGNED_INT, pixel);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return pixel[3] ? [...new Float32Array(pixel.buffer, 0, 3)] : null;
  }

  elements(program, layers, view, latest, ratio) {
    const { gl, canvas } = this;
    gl.useProgram(program.program);
    gl.uniformMatrix4fv(program.view, false, view);
    gl.uniform3fv(program.light, LIGHT);
    gl.uniform4fv(program.cut, this.cut.plane());
    for (const layer of layers) {
      const count = layer.shown ? upTo(layer.when, latest) : 0;
      if (!count) continue;
      gl.uniform1f(program.pointSize, ratio * (layer.name === "points" ? 2 : 4));
      gl.uniform1i(program.isShaded, layer.mode === gl.TRIANGLES ? 1 : 0);
      gl.bindVertexArray(layer.attributes);
      for (const [x, y] of layer.name === "route" ? WIDE : ONCE) {
        gl.uniform2f(program.shift, 2 * ratio * x / canvas.width, 2 * ratio * y / canvas.height);
        gl.drawElements(layer.mode, count * layer.corners, gl.UNSIGNED_INT, 0);
      }
    }
    gl.bindVertexArray(null);
  }
}
