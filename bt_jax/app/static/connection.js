// While the connection to the server is lost, nothing on the page can be used, and it looks like that: NiceGUI shows a popup
// then, which this follows. The focus is where it was once the connection is back.
document.addEventListener("DOMContentLoaded", () => {
  const popup = document.getElementById("popup");
  let focused = null;
  new MutationObserver(() => {
    const lost = popup.ariaHidden === "false";
    if (lost === document.body.classList.contains("offline")) return;
    if (lost) focused = document.activeElement;
    document.body.classList.toggle("offline", lost);
    for (const part of document.body.children) if (!part.matches(".nicegui-error-popup")) part.inert = lost;
    if (!lost) focused?.focus({ preventScroll: true });
    if (lost) askForLogin();
  }).observe(popup, { attributeFilter: ["aria-hidden"] });

  // A login ends after some hours, or with the server: then the form takes the place of the page.
  async function askForLogin() {
    const answer = await fetch("/favicon.ico", { cache: "no-store" }).catch(() => null);
    if (answer?.status === 401) location.reload();
    else if (document.body.classList.contains("offline")) setTimeout(askForLogin, 2000);
  }
});
