// Meshes of the scene, and poses [x, y, z, qw, qx, qy, qz].
import { THREE } from "nicegui-scene";

const TAG = 17; // height of the name of an object, pixels
const SMALL_TAG = 13; // and of one among many
const SLOT_TAG = 11; // and of a slot
const ROUND = 32; // sides of a cylinder

export function softwareOnly() {
  const gl = document.createElement("canvas").getContext("webgl");
  const info = gl && gl.getExtension("WEBGL_debug_renderer_info");
  return !info || /swiftshader|llvmpipe|software/i.test(gl.getParameter(info.UNMASKED_RENDERER_WEBGL));
}

export function setPose(object, pose) {
  object.position.set(pose[0], pose[1], pose[2]);
  object.quaternion.set(pose[4], pose[5], pose[6], pose[3]);
}

export function poseOf({ position: p, quaternion: q }) {
  return [p.x, p.y, p.z, q.w, q.x, q.y, q.z];
}

function geometryOf({ type, size }) {
  if (type === "cylinder") return new THREE.CylinderGeometry(size[0], size[0], 2 * size[1], ROUND).rotateX(Math.PI / 2);
  return new THREE.BoxGeometry(2 * size[0], 2 * size[1], 2 * size[2]);
}

// Lines along the edges of a shape; the sides of a cylinder are smooth.
function outline(geometry, material) {
  const lines = new THREE.LineSegments(new THREE.EdgesGeometry(geometry, 30), material);
  if (material.isLineDashedMaterial) lines.computeLineDistances();
  return lines;
}

// The name of an object, at its right, so that those of a stack keep apart.
export function nameTag(text, many) {
  const tag = textTag(text, "rgba(255, 255, 255, 0.88)", "#1d2733");
  tag.material.depthTest = false;
  tag.userData.height = many ? SMALL_TAG : TAG;
  tag.center.set(-19 / (tag.userData.height * tag.userData.shape), 0.5);
  return tag;
}

// The name of a slot, standing in it behind what is there.
export function slotTag(text) {
  const tag = textTag(text, "rgba(29, 39, 51, 0.45)", "#ffffff");
  tag.userData.height = SLOT_TAG;
  tag.center.set(0.5, 0);
  return tag;
}

function textTag(text, background, color) {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "500 42px sans-serif";
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 36;
  canvas.height = 64;
  context.font = font;
  context.fillStyle = background;
  context.beginPath();
  context.roundRect(0, 0, canvas.width, canvas.height, 20);
  context.fill();
  context.fillStyle = color;
  context.textBaseline = "middle";
  context.fillText(text, 18, 34);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  const material = { map: texture, transparent: true, sizeAttenuation: false };
  const tag = new THREE.Sprite(new THREE.SpriteMaterial(material));
  tag.userData.shape = canvas.width / canvas.height;
  tag.renderOrder = 10;
  return tag;
}

// Frees the graphics memory of an object and everything in it.
export function discard(object) {
  object.traverse(({ geometry, material }) => {
    geometry?.dispose();
    material?.map?.dispose();
    material?.dispose();
  });
}

// A translucent copy of an object.
export function ghostOf({ shape, size, color }, pose) {
  const [x, y, z] = size.map((edge) => (edge * 1.01) / 2);
  const geometry = geometryOf({ type: shape, size: shape === "cylinder" ? [x, z] : [x, y, z] });
  const dash = Math.cbrt(size[0] * size[1] * size[2]);
  const material = { color: new THREE.Color(...color), transparent: true, opacity: 0.3, depthWrite: false };
  const ghost = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(material));
  const dashes = { color: 0x1d2733, dashSize: dash / 9, gapSize: dash / 12 };
  ghost.add(outline(geometry, new THREE.LineDashedMaterial(dashes)));
  setPose(ghost, pose);
  return ghost;
}

// The mesh of a geom of the compiled scene.
export function meshOf(geom) {
  const geometry = geometryOf(geom);
  const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: new THREE.Color(...geom.color) }));
  setPose(mesh, geom.pose);
  if (geom.type !== "plane") {
    mesh.add(outline(geometry, new THREE.LineBasicMaterial({ color: 0x1d2733, transparent: true, opacity: 0.35 })));
  }
  return mesh;
}
