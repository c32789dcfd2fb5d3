// A camera that looks at a target from a distance, up being up. Angles in radians; yaw 0 looks
// from the east, pitch 90 degrees from above.

const FIELD_OF_VIEW = 40 * Math.PI / 180;
const STRAIGHT_DOWN = Math.PI / 2;

const add = (a, b, factor = 1) => a.map((value, i) => value + factor * b[i]);
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * b[i], 0);
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
];

class Camera {
  constructor(low, high, cell) {
    this.middle = low.map((value, i) => (value + high[i]) / 2);
    // Half of what is to be seen, and never smaller than a few cells.
    this.half = low.map((value, i) => Math.max((high[i] - value) / 2, cell));
    this.radius = Math.hypot(...this.half);
  }

  // Look at the broad side of the whole, as near as it fits into a part of the view in pixels.
  reset(width, height) {
    this.look(this.half[1] > 1.2 * this.half[0] ? -20 : -110, 40);
    this.target = [...this.middle];
    const { right, up, back } = this.axes(), across = Math.tan(FIELD_OF_VIEW / 2);
    const corners = [0, 1, 2, 3, 4, 5, 6, 7].map(
      (corner) => this.half.map((value, i) => (corner >> i & 1 ? value : -value)),
    );
    this.distance = Math.max(...corners.map((corner) => dot(corner, back) + 1.08 / across * Math.max(
      Math.abs(dot(corner, right)) * height / width, Math.abs(dot(corner, up)),
    )));
  }

  look(yaw, pitch) {
    this.yaw = yaw * Math.PI / 180;
    this.pitch = pitch * Math.PI / 180;
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.max(-STRAIGHT_DOWN, Math.min(STRAIGHT_DOWN, this.pitch + pitch));
  }

  // Scale the distance of everything from a point, which stays where it is in the view.
  zoom(factor, point = this.target) {
    const distance = Math.max(1e-4, Math.min(1e4, this.distance * factor / this.radius));
    const applied = distance * this.radius / this.distance;
    this.target = add(point, add(this.target, point, -1), applied);
    this.distance *= applied;
  }

  // Move by pixels, as far as what lies at the target's distance seems to move.
  pan(right, down, height) {
    const scale = this.pixel(height), axes = this.axes();
    this.target = add(add(this.target, axes.right, -right * scale), axes.up, down * scale);
  }

  // The size of a pixel at the target's distance.
  pixel(height) {
    return 2 * this.distance * Math.tan(FIELD_OF_VIEW / 2) / height;
  }

  axes() {
    const { yaw, pitch } = this;
    const back = [
      Math.cos(pitch) * Math.cos(yaw), Math.cos(pitch) * Math.sin(yaw), Math.sin(pitch),
    ];
    const right = [-Math.sin(yaw), Math.cos(yaw), 0];
    return { right, up: cross(back, right), back };
  }

  // The pixel, counted from the top left, that a place is seen at; null: it lies behind the eye.
  project(place, width, height) {
    const matrix = this.matrix(width, height);
    const [x, y, , depth] = [0, 1, 2, 3].map(
      (row) => dot([...place, 1], [0, 4, 8, 12].map((column) => matrix[column + row])),
    );
    return depth > 0 ? [(1 + x / depth) * width / 2, (1 - y / depth) * height / 2] : null;
  }

  // From the map's coordinates to those of the view, as WebGL takes them.
  matrix(width, height) {
    const { right, up, back } = this.axes();
    const eye = add(this.target, back, this.distance);
    const near = this.distance / 200, far = 3 * this.distance + 20 * this.radius;
    const y = 1 / Math.tan(FIELD_OF_VIEW / 2), x = y * height / width;
    const a = (far + near) / (near - far), b = 2 * far * near / (near - far);
    const rows = [
      [...right.map((value) => x * value), -x * dot(right, eye)],
      [...up.map((value) => y * value), -y * dot(up, eye)],
      [...back.map((value) => a * value), -a * dot(back, eye) + b],
      [...back.map((value) => -value), dot(back, eye)],
    ];
    return Float32Array.from({ length: 16 }, (_, i) => rows[i % 4][i >> 2]);
  }
}
