// Hooks into viser's client: this file and viser.css have all names of its elements and globals that a script needs.
// test_viser_private.py lists them, and checks that viser's source has them.
const viserClient = (() => {
  "use strict";
  const PANEL = "[data-floating-window]"; // panel of a wide window, and tabs that were torn off
  const SHEET = ".mantine-Paper-root[style*='bottom: 0']"; // panel of a phone
  const CHARTS = ".husky-charts"; // our charts; a wide window has them below the view, otherwise they are in the panel
  const SLIM = 0.3; // fraction of the window's height; a panel of less height is folded, and counts as free
  const NARROW = 160; // [px] if the free part is narrower or lower than this, the covered part counts as free, too
  const TALLEST = 1.3; // the whole angle of view is at most this many times as high as the free part is wide

  // Without a graphics card smooth edges more than double the time of a picture; ?antialias keeps them.
  const getContext = HTMLCanvasElement.prototype.getContext;
  const probe = getContext.call(document.createElement("canvas"), "webgl2");
  const renderer = probe?.getParameter(probe.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? probe.RENDERER);
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  const isSoftware = /SwiftShader|llvmpipe|softpipe|Microsoft Basic Render/.test(renderer);
  const drawsFast = isSoftware && !location.search.includes("antialias");
  if (drawsFast) {
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return getContext.call(this, kind, kind.startsWith("webgl") ? { ...options, antialias: false } : options);
    };
  }

  const covers = () => [...document.querySelectorAll(`${PANEL}, ${SHEET}, ${CHARTS}`)]
    .filter((element) => !element.matches(CHARTS) || getComputedStyle(element).position === "fixed")
    .map((element) => element.getBoundingClientRect()).filter((box) => box.width > 0 && box.height > 0);

  // Free part of the window, which nothing covers: [left, right, bottom], from the top.
  const free = () => {
    let [left, right, bottom] = [0, innerWidth, innerHeight];
    for (const box of covers()) {
      if (box.width > 0.9 * innerWidth) bottom = Math.min(bottom, box.top);
      else if (box.height < SLIM * innerHeight) continue;
      else if (box.left + box.right > innerWidth) right = Math.min(right, box.left);
      else left = Math.max(left, box.right);
    }
    if (right - left < NARROW) [left, right] = [0, innerWidth];
    return [left, right, bottom < NARROW ? innerHeight : bottom];
  };

  // The camera looks at the middle of the free part, and the scene is drawn behind the panel, too, by the view offset of
  // three.js. Called before each picture; a change of the panel causes a picture.
  let aimed = "";
  const aim = (_, __, camera) => {
    const { camera: seen, canvas } = window.__viserMutable ?? {};
    if (camera !== seen || canvas === null) return;
    const [left, right, bottom] = free();
    const { clientWidth: width, clientHeight: height } = canvas;
    const high = Math.min(bottom, TALLEST * (right - left)), wide = (high * width) / height;
    const offset = [wide, high, wide / 2 - (left + right) / 2, high / 2 - bottom / 2, width, height];
    if (aimed === offset.join() && camera.view !== null) return;
    aimed = offset.join();
    camera.setViewOffset(...offset);
  };

  // Without a graphics card the scene is drawn coarser, so the whole window costs as much as the part next to the panel.
  const COARSER = 0.62; // fraction of the screen's resolution
  const coarsen = () => {
    const settings = window.__viserTestpoints?.devSettings;
    if (drawsFast && settings?.get().fixedDpr === null) settings.set({ fixedDpr: COARSER * devicePixelRatio });
  };

  const follow = () => { // called repeatedly, because viser's elements appear and change at any time
    coarsen();
    const scene = window.__viserMutable?.scene;
    if (scene && scene.onBeforeRender !== aim) scene.onBeforeRender = aim;
    document.querySelectorAll(`${PANEL}, ${SHEET}, ${CHARTS}`).forEach((element) => {
      if (observed.has(element)) return; // otherwise its changes would be reported twice
      observed.add(element);
      resized.observe(element);
    });
  };
  const draw = () => window.__viserMutable?.requestRender();
  const observed = new WeakSet();
  const resized = new ResizeObserver(draw);
  window.addEventListener("resize", draw);
  document.addEventListener("pointermove", (event) => { if (event.buttons !== 0 && event.target.closest?.(PANEL)) draw(); }, true);

  const describe = () => { // gives names to viser's elements for screen readers
    document.querySelectorAll("canvas:not([aria-label])").forEach((canvas) => {
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", "3D view of the robot");
    });
    document.querySelectorAll(".mantine-Text-root > label").forEach((label) => {
      const row = label.parentElement.parentElement.parentElement;
      row.querySelectorAll("[role=slider]:is([aria-label=''], :not([aria-label])), input:not([aria-label], [type=hidden])").forEach((field) => {
        field.setAttribute("aria-label", label.textContent);
      });
      if (row.querySelector("button") !== null && !row.hasAttribute("role")) {
        row.setAttribute("role", "group");
        row.setAttribute("aria-label", label.textContent);
      }
    });
    document.querySelectorAll(".mantine-Notification-root").forEach((notice) => { // a notice covers the scene, and the tab View has its text
      if (!notice.textContent.startsWith("Software WebGL")) return;
      document.documentElement.classList.add("husky-draws-by-software");
      notice.querySelector("button")?.click();
    });
  };

  // A tap on the head of a phone's panel raises or lowers it, because viser would fold it and hide the emergency stop.
  document.addEventListener("click", (event) => {
    const head = event.target.closest?.(`${SHEET} [style*='height: 3.5em']`);
    if (!head) return;
    event.stopImmediatePropagation();
    document.documentElement.classList.toggle("husky-panel-up");
  }, true);

  const storage = (key) => `viser-user:${key}`; // key of the browser's storage that the server reads as `key`

  return { follow, describe, storage };
})();
