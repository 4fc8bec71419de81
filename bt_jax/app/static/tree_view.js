// A tree as SVG, coloured by classes of its nodes; a click, Enter or space folds and unfolds a subtree. While it is edited, a
// click or the focus selects a node, dragging moves it, and keys are told: arrows, with Alt to move it, and Delete.
const SMALLEST = 0.75; // scale; larger trees are scrolled
const EDGE = 0.3; // of a node's width: a node that is dropped there comes beside it, else inside
const DRAGGED = 6; // pixels that the pointer moves before it drags
const KEYS = ["ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Delete"];
const STATUSES = ["success", "failure", "running", "idle"];

export default {
  template: `<div class="tree-drawing" @pointerdown="onDown" @pointermove="onMove" @pointerup="onUp"
      @pointercancel="endDrag" @click="onClick" @keydown="onKey" :class="{ editing }">
    <div ref="drawing"></div>
    <div class="visually-hidden" role="group" aria-label="The tree" data-tree-text v-html="text"></div>
  </div>`,

  // svg is the drawing, text the same as a list, classes are the status classes of the nodes, words what those mean.
  // While it is edited: the id of the node that is selected, and those that are switched off.
  props: {
    svg: String, text: String, classes: Object, words: Object, editing: Boolean, selected: String, off: Array,
  },

  mounted() {
    this.observer = new ResizeObserver(() => this.fit());
    this.observer.observe(this.$el);
    this.draw();
  },

  beforeUnmount() {
    this.observer.disconnect();
  },

  watch: {
    svg() {
      this.draw();
    },
    classes() {
      this.colour(this.classes);
    },
    selected() {
      this.mark();
    },
    off() {
      this.mark();
    },
    editing() {
      this.draw();
    },
  },

  methods: {
    draw() {
      const focused = this.$el.contains(document.activeElement) ? document.activeElement.id : "";
      this.$refs.drawing.innerHTML = this.svg;
      for (const text of this.$el.querySelectorAll("svg text")) text.setAttribute("aria-hidden", "true"); // the list says it
      this.colour(this.classes);
      this.fit();
      this.mark();
      if (focused && !this.editing) this.$el.querySelector(`[id="${focused}"]`)?.focus();
      if (focused && this.editing) this.$el.querySelector(".selected")?.focus();
    },

    // Shows what is selected and what is switched off; one node at a time can be reached with Tab.
    mark() {
      const within = this.$el.contains(document.activeElement) && document.activeElement !== this.$el;
      for (const node of this.$el.querySelectorAll(".node")) {
        const name = this.editable(node);
        node.classList.toggle("off", this.editing && (this.off ?? []).includes(name));
        const chosen = this.editing && node.id === this.selected;
        node.classList.toggle("selected", chosen);
        if (!this.editing || node.id !== name) continue;
        node.setAttribute("tabindex", chosen ? "0" : "-1");
        node.setAttribute("role", "button");
        node.setAttribute("aria-pressed", chosen);
        node.removeAttribute("aria-expanded");
        if (chosen && within) node.focus();
      }
    },

    // The id of the node that is edited: inside a gene, that of the gene.
    editable(node) {
      return node?.id.match(/^node-\d+/)?.[0] ?? "";
    },

    nodeAt(event) {
      const node = document.elementFromPoint(event.clientX, event.clientY)?.closest?.(".node");
      return node && this.$el.contains(node) ? node : null;
    },

    colour(classes) {
      for (const node of this.$el.querySelectorAll(".node")) {
        const status = classes[node.id];
        if (!status || node.classList.contains(status)) continue;
        node.classList.remove(...STATUSES);
        node.classList.add(status);
        if (node.tabIndex >= 0) node.setAttribute("aria-description", this.words[status]);
      }
      this.follow();
    },

    // Scrolls to the node that is running, if it is out of sight.
    follow() {
      const node = [...this.$el.querySelectorAll(".node.running")].at(-1);
      if (!node) return;
      const [at, room] = [node.getBoundingClientRect(), this.$el.getBoundingClientRect()];
      if (at.left < room.left || at.right > room.right) this.$el.scrollLeft += at.left - room.left - 24;
      if (at.top < room.top || at.bottom > room.bottom) this.$el.scrollTop += at.bottom - room.bottom + 24;
    },

    fit() {
      const svg = this.$refs.drawing.firstElementChild;
      if (!svg || !this.$el.clientWidth) return;
      const { width, height } = svg.viewBox.baseVal;
      const room = Math.min(this.$el.clientWidth / width, this.$el.clientHeight / height);
      const scale = Math.max(SMALLEST, Math.min(1, room));
      svg.setAttribute("width", width * scale);
      svg.setAttribute("height", height * scale);
    },

    foldable(event) {
      return event.target.closest?.(".foldable")?.id;
    },

    // Not on "click": there is none if the tree is drawn again between press and release.
    onDown(event) {
      if (this.editing) {
        const name = this.editable(event.target.closest?.(".node"));
        this.drag = event.button === 0 && name ? { name, x: event.clientX, y: event.clientY, on: false } : undefined;
        return;
      }
      this.pressed = event.button === 0 ? this.foldable(event) : undefined;
    },

    onMove(event) {
      if (!this.drag) return;
      const far = Math.hypot(event.clientX - this.drag.x, event.clientY - this.drag.y) > DRAGGED;
      if (!this.drag.on && !far) return;
      if (!this.drag.on) this.$el.setPointerCapture(event.pointerId);
      this.drag.on = true;
      this.unmarkGoal();
      const node = this.nodeAt(event), to = this.editable(node);
      this.drag.goal = undefined;
      if (!to || to === this.drag.name) return;
      const box = node.getBoundingClientRect(), across = (event.clientX - box.left) / box.width;
      const where = across < EDGE ? "before" : across > 1 - EDGE ? "after" : "inside";
      this.drag.goal = { to, where };
      node.classList.add(`drop-${where}`);
    },

    endDrag() {
      this.drag = undefined;
      this.unmarkGoal();
    },

    unmarkGoal() {
      for (const where of ["before", "inside", "after"])
        for (const node of this.$el.querySelectorAll(`.drop-${where}`)) node.classList.remove(`drop-${where}`);
    },

    onUp(event) {
      if (this.editing) {
        const drag = this.drag;
        this.endDrag();
        if (drag?.on && drag.goal) this.$emit("move", { node: drag.name, ...drag.goal });
        if (!drag || drag.on) return;
        this.$el.querySelector(`[id="${drag.name}"]`)?.focus();
        this.$emit("select", drag.name);
        return;
      }
      const name = this.foldable(event);
      if (name && name === this.pressed) this.$emit("toggle", name);
      this.pressed = undefined;
    },

    // Clicks without a pointer, from assistive technology.
    onClick(event) {
      const name = event.detail === 0 && this.foldable(event);
      if (this.editing && event.detail === 0) this.$emit("select", this.editable(event.target.closest?.(".node")));
      else if (name) this.$emit("toggle", name);
    },

    onKey(event) {
      if (this.editing) {
        if (!KEYS.includes(event.key) || event.ctrlKey || event.metaKey || event.shiftKey) return;
        event.preventDefault();
        this.$emit("key", { key: event.key, alt: event.altKey });
        return;
      }
      const name = this.foldable(event);
      if (!name || (event.key !== "Enter" && event.key !== " ")) return;
      event.preventDefault();
      this.$emit("toggle", name);
    },
  },
};
