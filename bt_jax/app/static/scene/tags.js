// Names in the scene: of objects, beside them, and of slots. They keep their size on the screen.
import { THREE } from "nicegui-scene";

const NAME = { height: 17, rank: 0 }; // of an object: height in pixels; what has a lower rank is shown first
const SMALL_NAME = { height: 13, rank: 0 }; // and of one among many
const SLOT = { height: 11, rank: 1 };
const ASIDE = 19; // pixels from the middle of an object to its name
const SLACK = 3; // pixels by which names may overlap

// The name of an object, beside it, so that those of a stack keep apart.
export function nameTag(text, many) {
  const tag = textTag(text, "rgba(255, 255, 255, 0.88)", "#1d2733", many ? SMALL_NAME : NAME);
  const aside = ASIDE / (tag.userData.height * tag.userData.shape);
  tag.userData.sides = [-aside, 1 + aside];
  return tag;
}

// The name of a slot, below its middle, so that what stands there is seen.
export function slotTag(text) {
  const tag = textTag(text, "rgba(29, 39, 51, 0.6)", "#ffffff", SLOT);
  tag.center.set(0.5, 1.15);
  tag.userData.sides = [0.5];
  return tag;
}

function textTag(text, background, color, kind) {
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
  const material = { map: texture, transparent: true, sizeAttenuation: false, depthTest: false };
  const tag = new THREE.Sprite(new THREE.SpriteMaterial(material));
  tag.userData = { ...kind, shape: canvas.width / canvas.height };
  tag.renderOrder = 10 - kind.rank;
  return tag;
}

// Shows the names that leave each other room in a picture of this size in pixels, the nearest first. The name of an object at the
// right edge is at the left of it.
export function keepApart(tags, camera, [width, height]) {
  camera.updateMatrixWorld();
  const seen = tags.map((tag) => ({ tag, at: tag.getWorldPosition(new THREE.Vector3()).project(camera) }));
  seen.sort((a, b) => a.tag.userData.rank - b.tag.userData.rank || a.at.z - b.at.z);
  const shown = [];
  for (const { tag, at } of seen) {
    const boxes = tag.userData.sides.map((side) => boxOf(tag, side, at, width, height));
    const fitting = Math.max(0, boxes.findIndex(({ right }) => right <= width));
    tag.center.x = tag.userData.sides[fitting];
    tag.visible = !shown.some((other) => overlap(boxes[fitting], other));
    if (tag.visible) shown.push(boxes[fitting]);
  }
}

function boxOf(tag, side, at, width, height) {
  const across = tag.userData.height * tag.userData.shape;
  const left = ((at.x + 1) / 2) * width - side * across;
  const top = ((1 - at.y) / 2) * height - (1 - tag.center.y) * tag.userData.height;
  return { left, right: left + across, top, bottom: top + tag.userData.height };
}

function overlap(a, b) {
  return a.left < b.right - SLACK && b.left < a.right - SLACK && a.top < b.bottom - SLACK && b.top < a.bottom - SLACK;
}
