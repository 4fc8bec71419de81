// Meshes of the scene, and poses [x, y, z, qw, qx, qy, qz].
import { THREE } from "nicegui-scene";

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

// Frees the graphics memory of an object and everything in it.
export function discard(object) {
  object.traverse((part) => {
    part.geometry?.dispose();
    part.material?.map?.dispose();
    part.material?.dispose();
    if (part.isLight) part.dispose();
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
  mesh.castShadow = mesh.receiveShadow = true;
  if (geom.type !== "plane") {
    mesh.add(outline(geometry, new THREE.LineBasicMaterial({ color: 0x1d2733, transparent: true, opacity: 0.35 })));
  }
  return mesh;
}
