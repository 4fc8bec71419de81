// A picture that is loaded again whenever `src` changes, each once the one before is there: a slow connection gets fewer. Where it
// may be dragged on, the event "drag" tells from which place to which, in shares of its width and height from the top left.
export default {
  template: `
    <div class="robot-picture" :class="{ live: drags }">
      <img ref="picture" :src="shown" :alt="alt" draggable="false" @load="loaded" @error="loaded"
        @pointerdown="begin" @pointermove="move" @pointerup="end" @pointercancel="from = null" />
      <svg v-if="from" viewBox="0 0 1 1" preserveAspectRatio="none" aria-hidden="true">
        <line :x1="from[0]" :y1="from[1]" :x2="to[0]" :y2="to[1]" vector-effect="non-scaling-stroke" />
      </svg>
    </div>`,
  props: { src: String, alt: String, drags: Boolean },
  data() {
    return { shown: this.src, loading: Boolean(this.src), from: null, to: null };
  },
  watch: {
    src(wanted) {
      if (!this.loading) this.load(wanted);
    },
  },
  methods: {
    load(wanted) {
      this.loading = wanted !== this.shown && Boolean(wanted);
      this.shown = wanted;
    },
    loaded() {
      this.loading = false;
      if (this.src !== this.shown) this.load(this.src);
    },
    place(event) {
      const { left, top, width, height } = this.$refs.picture.getBoundingClientRect();
      return [(event.clientX - left) / width, (event.clientY - top) / height];
    },
    begin(event) {
      if (!this.drags || event.button !== 0) return;
      event.target.setPointerCapture(event.pointerId);
      this.from = this.to = this.place(event);
    },
    move(event) {
      if (this.from) this.to = this.place(event);
    },
    end(event) {
      if (!this.from) return;
      this.$emit("drag", { start: this.from, end: this.place(event) });
      this.from = null;
    },
  },
};
