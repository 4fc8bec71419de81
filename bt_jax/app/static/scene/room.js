// What things stand in: light from a window at the left, shadows, and a ground that fades into what is behind.
import { THREE } from "nicegui-scene";

const RINGS = 24;
const FADE = 2.6; // radius of the ground, in half widths of what is shown

// Lights for a scene; the shadows of `software` are coarse.
export function lightsOf({ shown: [low, high], light }, software) {
  const sky = new THREE.HemisphereLight(0xffffff, 0xaeb4bb, 1.75);
  const key = new THREE.DirectionalLight(0xfff8ee, 1.75);
  const middle = new THREE.Vector3(...low).add(new THREE.Vector3(...high)).divideScalar(2);
  const radius = new THREE.Vector3(...low).distanceTo(new THREE.Vector3(...high)) / 2;
  const from = new THREE.Vector3(...light).normalize();
  key.position.copy(middle).addScaledVector(from, 3 * radius);
  key.target.position.copy(middle);
  key.castShadow = true;
  key.shadow.mapSize.setScalar(software ? 1024 : 2048);
  Object.assign(key.shadow.camera, { left: -radius, right: radius, bottom: -radius, top: radius, near: radius, far: 6 * radius });
  key.shadow.bias = -0.0005;
  key.shadow.normalBias = 0.004 * radius;
  key.shadow.radius = 3;
  return [sky, key, key.target];
}

// The ground under a scene, which fades into the colour `behind` it, and the shadows on it; these take `software` as long as
// all the rest.
export function groundOf({ shown: [low, high], floor }, ground, behind, software) {
  const [width, depth] = [high[0] - low[0], high[1] - low[1]];
  const radius = (FADE * Math.hypot(width, depth)) / 2;
  const disc = new THREE.RingGeometry(0, radius, 48, RINGS);
  const colors = [];
  const { position } = disc.attributes;
  for (let i = 0; i < position.count; i++) {
    const part = Math.hypot(position.getX(i), position.getY(i)) / radius;
    colors.push(...ground.clone().lerp(behind, THREE.MathUtils.smoothstep(part, 0.2, 1)).toArray());
  }
  disc.setAttribute("color", new THREE.Float32BufferAttribute(colors, 3));
  const seen = new THREE.Mesh(disc, new THREE.MeshBasicMaterial({ vertexColors: true }));
  const under = new THREE.Group();
  under.add(seen);
  under.position.set((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, floor);
  if (software) return under;
  const side = 1.6 * Math.max(width, depth);
  const shade = new THREE.Mesh(
    new THREE.PlaneGeometry(side, side),
    new THREE.ShadowMaterial({ opacity: 0.22, depthWrite: false }),
  );
  shade.receiveShadow = true;
  shade.position.z = 0.001;
  under.add(shade);
  return under;
}
