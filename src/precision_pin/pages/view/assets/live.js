(function () {
  "use strict";
  const frame = document.getElementById("page");
  const ended = document.getElementById("ended");
  let shown = null;
  const settings = new URLSearchParams(location.hash.slice(1));

  frame.addEventListener("load", function () {
    document.title = frame.contentDocument?.title || document.title;
  });

  function load(version) {
    // the reader's sliders and view, where it is the page: they outlast a mistake in a file
    const state = frame.contentDocument?.body?.dataset ?? {};
    for (const name of "factor" in state ? ["about", "factor", "look", "pose", "boxes", "camera"] : []) {
      if (name in state) {
        settings.set(name, state[name]);
      } else {
        settings.delete(name);
      }
    }
    shown = version;
    frame.contentWindow.location.replace("/page?" + version + "#" + settings);
  }

  async function ask() {
    try {
      const answer = await fetch("/version");
      if (!answer.ok) {
        throw new Error(answer.statusText);
      }
      const version = await answer.text();
      ended.hidden = true;
      if (version !== shown) {
        load(version);
      }
    } catch {
      ended.hidden = false;
    }
    setTimeout(ask, 500);
  }
  ask();
})();
