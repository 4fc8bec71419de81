// The camera: a view that shows everything, turned and zoomed by keys.
import { THREE } from "nicegui-scene";

const AXIS = new THREE.Vector3(0, 0, 1);
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
    this.camera.aspect = width / height;
    this.fit();
    this.draw();
  },

  // Sets the angle of view that shows everything across, and up and down.
  fit() {
    const { across, upright } = this.model.camera;
    const tangent = Math.max(upright, across / this.camera.aspect);
    this.camera.fov = 2 * THREE.MathUtils.radToDeg(Math.atan(tangent));
    this.camera.updateProjectionMatrix();
    const pixel = (2 * tangent) / this.$el.clientHeight;
    for (const tag of this.tags) {
      const height = tag.userData.height * pixel;
      tag.scale.set(height * tag.userData.shape, height, 1);
    }
  },

  lookAtAll() {
    const { eye, target } = this.model.camera;
    this.camera.position.set(...eye);
    this.controls.target.set(...target);
    this.controls.update();
    this.draw();
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
    this.controls.update();
    this.draw();
  },
};
