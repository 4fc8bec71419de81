// Light, dark or high contrast: as the system says, or as chosen on the page, which the browser remembers. The style sheets see
// it as data-scheme (light, dark) and data-contrast (normal, more) of <html>; scripts hear the event "appearance".
(() => {
  const root = document.documentElement;
  const [dark, contrast] = ["(prefers-color-scheme: dark)", "(prefers-contrast: more)"].map((query) => matchMedia(query));
  let choice = remembered.get("appearance", "system");

  function apply() {
    const isDark = choice === "dark" || (choice !== "light" && dark.matches);
    root.dataset.scheme = isDark ? "dark" : "light";
    root.dataset.contrast = choice === "contrast" || contrast.matches ? "more" : "normal";
    window.setDark?.(isDark); // of NiceGUI
    for (const field of document.querySelectorAll("[data-appearance]")) field.value = choice;
    window.dispatchEvent(new Event("appearance"));
  }

  document.addEventListener("change", (event) => {
    if (!event.target.matches("[data-appearance]")) return;
    choice = event.target.value;
    remembered.set("appearance", choice);
    apply();
  });
  for (const query of [dark, contrast]) query.addEventListener("change", apply);
  window.addEventListener("load", apply);
  apply();
})();
