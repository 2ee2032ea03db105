// Drives from the page by the keys W A S D and the pad while they are held, and sends the emergency stop.
// A held command is sent repeatedly; if the page or the network has gone or the key is released, the robot stops.
(() => {
  "use strict";
  const PERIOD = 50; // [ms] between two commands while something is held
  const KEYS = { KeyW: [1, 0], KeyS: [-1, 0], KeyA: [0, 1], KeyD: [0, -1] };
  const LOST = "Connection lost: the simulator has ended, or the network is down. Run ./dev launch again; this page waits for it.";
  const PENDING = "Connection lost: the emergency stop has NOT been confirmed. It will be sent as soon as the connection is back.";
  const SENT = "The emergency stop that you pressed has now been sent.";
  const ANSWER_TIME = 1000; // [ms] if the server does not confirm an emergency stop in this time, the connection counts as lost
  const held = new Set();
  let pad = null; // [linear, angular], each -1..1, while the pad is dragged
  let socket = null;
  let stopIsPending = false; // the emergency stop was pressed, and the server has not confirmed it
  let answerTimer = null;
  let timer = null;

  const root = document.documentElement;
  const say = (text) => { // shows a text above everything else; an empty text hides it
    let banner = document.querySelector(".husky-banner");
    if (banner === null && text !== "") {
      banner = document.createElement("div");
      banner.className = "husky-banner";
      banner.setAttribute("role", "alert");
      root.append(banner);
    }
    if (banner !== null) banner.textContent = text;
  };
  root.classList.add("husky-connecting"); // hides viser's panel for developers
  const ready = setInterval(() => {
    if (document.querySelector(".husky-e-stop") === null) return;
    clearInterval(ready);
    root.classList.remove("husky-connecting");
    spoken.className = "husky-spoken";
    spoken.setAttribute("role", "status"); // a screen reader reads it when its text changes; the state bar changes all the time
    document.body.append(spoken);
    const scenePad = document.createElement("div"); // pad of a phone, over the scene
    scenePad.className = "husky-pad husky-scene-pad";
    scenePad.setAttribute("aria-hidden", "true");
    scenePad.innerHTML = '<div class="husky-knob"></div>';
    document.body.append(scenePad);
    setInterval(describe, 500);
  }, 100);
  const spoken = document.createElement("div");
  const describe = () => {
    viserClient.follow();
    viserClient.describe();
    const state = document.querySelector(".husky-state b")?.textContent ?? "";
    if (spoken.textContent !== state) spoken.textContent = state;
  };

  try { // the server reads whether the page is dark: the user's choice on this page, otherwise the browser's setting
    const prefers = matchMedia("(prefers-color-scheme: dark)").matches ? "1" : "0";
    localStorage.setItem(viserClient.storage("is-dark"), localStorage.getItem(viserClient.storage("dark")) ?? prefers);
  } catch { /* without storage, the page has light colours */ }

  const connect = () => {
    socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/drive`);
    socket.onopen = () => {
      if (stopIsPending) send({ e_stop: true });
      else say("");
    };
    socket.onmessage = (event) => { // the server confirms that it has published e_stop
      if (!stopIsPending || !JSON.parse(event.data).e_stop) return;
      stopIsPending = false;
      if ((document.querySelector(".husky-banner")?.textContent ?? "") === "") return;
      say(SENT);
      setTimeout(() => say(socket.readyState === WebSocket.OPEN ? "" : LOST), 6000);
    };
    socket.onclose = () => {
      say(stopIsPending ? PENDING : LOST);
      setTimeout(connect, 1000);
    };
  };
  const send = (message) => {
    const isOpen = socket !== null && socket.readyState === WebSocket.OPEN;
    if (isOpen) socket.send(JSON.stringify(message));
    if (!("e_stop" in message)) return;
    stopIsPending = message.e_stop; // a release is not sent again later, because the situation may have changed
    clearTimeout(answerTimer);
    if (stopIsPending && !isOpen) say(PENDING);
    // a connection that the network has lost stays open for long, and takes messages that never arrive
    if (stopIsPending && isOpen) answerTimer = setTimeout(giveUp, ANSWER_TIME, socket);
  };
  const giveUp = (connection) => {
    if (!stopIsPending) return;
    say(PENDING);
    connection.close(); // its onclose connects again, and the stop is then sent again
  };
  const command = () => {
    if (pad !== null) return pad;
    const sum = [0, 0];
    held.forEach((code) => KEYS[code].forEach((value, index) => (sum[index] += value)));
    return sum;
  };
  const isHeld = () => pad !== null || held.size > 0;
  const update = () => {
    const [linear, angular] = command();
    if (isHeld()) {
      send({ linear, angular });
      if (timer === null) timer = setInterval(update, PERIOD);
    } else if (timer !== null) {
      clearInterval(timer);
      timer = null;
      send({ linear: 0, angular: 0 });
    }
    drawKnob(linear, angular);
  };
  const release = () => {
    pad = null;
    releaseKeys();
  };
  const releaseKeys = () => {
    held.clear();
    update();
  };
  const drawKnob = (linear, angular) => {
    document.querySelectorAll(".husky-knob").forEach((knob) => {
      knob.style.transform = `translate(${-angular * 60}px, ${-linear * 60}px)`;
    });
  };

  // Text can be typed into the focused element. A checkbox keeps the focus after a click, but takes no text, so
  // the keys must still stop and drive the robot.
  const NO_TEXT = "[type=checkbox], [type=radio], [type=range], [type=button], [type=file], [type=color]";
  const isTyping = (target) =>
    target instanceof Element && !target.matches(NO_TEXT) &&
    target.closest("input, textarea, select, [contenteditable=true]") !== null;
  window.addEventListener("keydown", (event) => {
    if (event.code === "Space" && !isTyping(event.target)) { // also if a button has the focus; Enter presses the button
      event.stopImmediatePropagation();
      event.preventDefault();
      release();
      if (!event.repeat) send({ e_stop: true });
      return;
    }
    if (event.repeat && stopButton(event.target) !== null) event.preventDefault(); // a held Enter presses the button once
    if (event.key === "Meta") releaseKeys(); // macOS sends no keyup of a letter while the Command key is down
    if (!(event.code in KEYS) || event.ctrlKey || event.altKey || event.metaKey || isTyping(event.target)) return;
    event.stopImmediatePropagation(); // viser would move the camera by the same keys
    event.preventDefault();
    if (!event.repeat) {
      held.add(event.code);
      update();
    }
  }, true);
  window.addEventListener("keyup", (event) => {
    if (event.code === "Space" && !isTyping(event.target)) event.preventDefault(); // does not press a focused button
    if (held.delete(event.code)) {
      event.stopImmediatePropagation();
      update();
    }
  }, true);
  window.addEventListener("contextmenu", (event) => { // a menu takes the keyup; the 3D scene opens none
    if (!event.defaultPrevented) releaseKeys();
  });
  window.addEventListener("blur", release);
  window.addEventListener("pagehide", release);
  document.addEventListener("visibilitychange", () => { if (document.hidden) release(); });

  // A cursor in a chart: the values at the mouse, read off the curves.
  const cursor = document.createElement("div");
  cursor.className = "husky-cursor";
  document.addEventListener("pointermove", (event) => {
    const svg = event.target instanceof Element ? event.target.closest(".husky-chart svg") : null;
    const [left, right, top, bottom, low, high, seconds] = svg?.dataset.plot.split(",").map(Number) ?? [];
    const box = svg?.getBoundingClientRect();
    const scale = box?.width / svg?.viewBox.baseVal.width;
    const x = (event.clientX - box?.left) / scale;
    if (!(x >= left && x <= right)) return cursor.remove();
    const values = [...svg.querySelectorAll("path.curve")].map((curve) => {
      const points = curve.getAttribute("d").split(/[ML]/).slice(1).map((point) => point.split(",").map(Number));
      const nearest = points.reduce((best, point) => (Math.abs(point[0] - x) < Math.abs(best[0] - x) ? point : best), [Infinity, NaN]);
      const value = high - ((nearest[1] - top) / (bottom - top)) * (high - low);
      return Math.abs(nearest[0] - x) > 6 ? "\u2013" : value.toFixed(2); // a dash in a gap of the curve
    });
    cursor.textContent = `${(((x - right) / (right - left)) * seconds).toFixed(1)} s: ${values.join(" / ")}`;
    cursor.style.cssText = `left: ${event.clientX}px; top: ${box.top + top * scale}px; height: ${(bottom - top) * scale}px`;
    cursor.classList.toggle("left", x > (left + right) / 2);
    document.body.append(cursor);
  });

  const clamp = (value) => Math.max(-1, Math.min(1, value));
  const follow = (element, event) => {
    const box = element.getBoundingClientRect();
    const half = box.width / 2;
    const reach = 0.8 * half; // distance from the middle with the full speed
    pad = [clamp((box.top + half - event.clientY) / reach), clamp((box.left + half - event.clientX) / reach)];
    update();
  };
  document.addEventListener("pointerdown", (event) => {
    const element = event.target instanceof Element ? event.target.closest(".husky-pad") : null;
    if (element === null) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    element.setPointerCapture(event.pointerId);
    element.onpointermove = (move) => follow(element, move);
    element.onpointerup = element.onpointercancel = element.onlostpointercapture = () => {
      element.onpointermove = null;
      release();
    };
    follow(element, event);
  }, true);
  document.addEventListener("pointerdown", (event) => {
    // while an object is dragged, viser prevents the default in a passive listener, which only logs errors
    if (event.target instanceof HTMLCanvasElement) event.preventDefault = () => {};
  }, true);
  // the button may be replaced while it is held down, and then no click comes; so the button that was pressed counts
  const stopButton = (element) => (element instanceof Element ? element.closest("[data-husky-e-stop]") : null);
  const sendStop = (button) => send({ e_stop: button.dataset.huskyEStop === "true" });
  let pressed = null;
  document.addEventListener("pointerdown", (event) => {
    pressed = event.button === 0 ? stopButton(event.target) : null;
  }, true);
  document.addEventListener("pointerup", (event) => {
    const isOver = stopButton(document.elementFromPoint(event.clientX, event.clientY)) !== null;
    if (pressed !== null && isOver) sendStop(pressed);
    pressed = null;
  }, true);
  document.addEventListener("click", (event) => {
    const button = event.detail === 0 ? stopButton(event.target) : null; // pressed by a key, not by a pointer
    if (button !== null) sendStop(button);
  }, true);
  window.addEventListener("load", () => {
    if (location.search.includes("token=")) history.replaceState(null, "", "/"); // the token is now a cookie
  });
  connect();
})();
