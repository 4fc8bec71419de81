// The camera: views that show everything, from where a person wants to look; turned and zoomed by keys.
import { THREE } from "nicegui-scene";

const AXIS = new THREE.Vector3(0, 0, 1);
const HALF = Math.tan(THREE.MathUtils.degToRad(15)); // tangent of half the angle of view, across the shorter side
const MARGIN = 1.04; // by which a view is wider than what it shows
const NEARER = 0.8;
const LOOKS = {
  ArrowLeft: [-0.1, 0, 1],
  ArrowRight: [0.1, 0, 1],
  ArrowUp: [0, 0.1, 1],
  ArrowDown: [0, -0.1, 1],
  "+": [0, 0, 0.9],
  "=": [0, 0, 0.9],
  "-": [0, 0, 1.1],
};

// Methods of the component.
export const view = {
  resize() {
    const { clientWidth: width, clientHeight: height } = this.$el;
    if (!width || !height) return;
    this.extent = [width, height];
    this.renderer.setSize(width, height, false);
    Object.assign(this.$el.children[0].style, { width: `${width}px`, height: `${height}px` });
    const aspect = width / height;
    const tangent = aspect < 1 ? HALF / aspect : HALF;
    this.camera.aspect = aspect;
    this.camera.fov = 2 * THREE.MathUtils.radToDeg(Math.atan(tangent));
    this.camera.updateProjectionMatrix();
    const pixel = (2 * tangent) / height;
    for (const tag of this.tags) {
      const size = tag.userData.height * pixel;
      tag.scale.set(size * tag.userData.shape, size, 1);
    }
    if (this.looking) this.look(this.looking);
    this.redraw();
  },

  // Looks from one of the model's views, or goes nearer or farther.
  look(name) {
    if (name === "nearer") return this.lookFrom(0, 0, NEARER);
    if (name === "farther") return this.lookFrom(0, 0, 1 / NEARER);
    this.showAll(new THREE.Vector3(...this.model.views[name]));
    this.looking = name; // until a person turns it
  },

  // Shows everything from a direction, as large and as much in the middle as possible.
  showAll(towards) {
    const across = new THREE.Vector3().crossVectors(AXIS, towards).normalize();
    const upright = new THREE.Vector3().crossVectors(towards, across);
    const corners = cornersOf(...this.model.shown);
    const middle = corners.reduce((sum, corner) => sum.addScaledVector(corner, 1 / corners.length), new THREE.Vector3());
    const [high, wide] = [HALF / Math.min(1, this.camera.aspect), HALF * Math.max(1, this.camera.aspect)];
    let distance = 1;
    for (let i = 0; i < 8; i++) {
      const from = corners.map((corner) => corner.clone().sub(middle));
      const seen = from.map((one) => ({ x: one.dot(across), y: one.dot(upright), near: one.dot(towards) }));
      distance = Math.max(...seen.map(({ x, y, near }) => near + MARGIN * Math.max(Math.abs(x) / wide, Math.abs(y) / high)));
      for (const [axis, key] of [[across, "x"], [upright, "y"]]) {
        const parts = seen.map((one) => one[key] / (distance - one.near));
        middle.addScaledVector(axis, (distance * (Math.min(...parts) + Math.max(...parts))) / 2);
      }
    }
    this.controls.target.copy(middle);
    this.camera.position.copy(middle).addScaledVector(towards, distance);
    this.controls.minDistance = distance / 12;
    this.controls.maxDistance = distance * 3;
    this.controls.update();
    this.redraw();
  },

  lookAtAll() {
    this.look("home");
  },

  // Tells Python by how many quarters the view is turned, counter-clockwise as seen from above.
  tellQuarter() {
    const [across, along] = this.model.views.home;
    const { x, y } = this.camera.position.clone().sub(this.controls.target);
    const turned = Math.atan2(y, x) - Math.atan2(along, across);
    const quarter = (Math.round(turned / (Math.PI / 2)) + 8) % 4;
    if (quarter === this.quarter) return;
    this.quarter = quarter;
    this.$emit("quarter", quarter);
  },

  onKey(event) {
    if (event.key === "Escape") this.cancelDrag();
    if (event.target === this.$el.children[0] && event.key in LOOKS) {
      event.preventDefault();
      this.lookFrom(...LOOKS[event.key]);
    }
  },

  // Turns the view about its target, by radians to the right and up, and multiplies its distance.
  lookFrom(right, up, times) {
    const { target } = this.controls;
    const offset = this.camera.position.clone().sub(target);
    const across = new THREE.Vector3().crossVectors(AXIS, offset).normalize();
    offset.applyAxisAngle(across, -up).applyAxisAngle(AXIS, right).multiplyScalar(times);
    this.camera.position.copy(target).add(offset);
    this.looking = null;
    this.controls.update();
    this.redraw();
  },
};

function cornersOf(low, high) {
  return [0, 1, 2, 3, 4, 5, 6, 7].map((i) => new THREE.Vector3(...[0, 1, 2].map((k) => ((i >> k) & 1 ? high[k] : low[k]))));
}
