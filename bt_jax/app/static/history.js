// Back and Forward stay in the page: each step is an entry of the history, which the server has made.
window.addEventListener("popstate", () => emitEvent("step_in_history", new URL(location).searchParams.get("step") ?? ""));
