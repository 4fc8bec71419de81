// A tree as SVG, coloured by classes of its nodes; a click, Enter or space folds and unfolds a subtree.
const SMALLEST = 0.75; // scale; larger trees are scrolled
const STATUSES = ["success", "failure", "running", "idle"];

export default {
  template: `<div class="tree-drawing" @pointerdown="onDown" @pointerup="onUp" @click="onClick" @keydown="onKey">
    <div ref="drawing"></div>
    <div class="visually-hidden" role="group" aria-label="The tree" data-tree-text v-html="text"></div>
  </div>`,

  // svg is the drawing, text the same as a list, classes are the status classes of the nodes, words what those mean.
  props: { svg: String, text: String, classes: Object, words: Object },

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
  },

  methods: {
    draw() {
      const focused = this.$el.contains(document.activeElement) ? document.activeElement.id : "";
      this.$refs.drawing.innerHTML = this.svg;
      for (const text of this.$el.querySelectorAll("svg text")) text.setAttribute("aria-hidden", "true"); // the list says it
      this.colour(this.classes);
      this.fit();
      if (focused) this.$el.querySelector(`[id="${focused}"]`)?.focus();
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
      this.pressed = event.button === 0 ? this.foldable(event) : undefined;
    },

    onUp(event) {
      const name = this.foldable(event);
      if (name && name === this.pressed) this.$emit("toggle", name);
      this.pressed = undefined;
    },

    // Clicks without a pointer, from assistive technology.
    onClick(event) {
      const name = event.detail === 0 && this.foldable(event);
      if (name) this.$emit("toggle", name);
    },

    onKey(event) {
      const name = this.foldable(event);
      if (!name || (event.key !== "Enter" && event.key !== " ")) return;
      event.preventDefault();
      this.$emit("toggle", name);
    },
  },
};
