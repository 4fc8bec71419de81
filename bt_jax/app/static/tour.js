// The tour begins by itself on the first visit, once the server listens; and what it speaks of is lit up.
window.tour = {
  show(selector) {
    for (const lit of document.querySelectorAll(".tour-lit")) lit.classList.remove("tour-lit");
    const thing = selector ? document.querySelector(selector) : null;
    thing?.classList.add("tour-lit");
    thing?.scrollIntoView({ block: "nearest", inline: "nearest" });
  },
  seen: () => remembered.set("tour", "seen"),
};
window.addEventListener("load", () => {
  if (remembered.get("tour", "") === "seen") return;
  const waiting = setInterval(() => {
    if (window.socket?.id === undefined) return;
    clearInterval(waiting);
    emitEvent("tour_first_visit");
  }, 100);
});
