// Replays one run: dragging turns the view, the wheel or two fingers zoom, the space bar pauses.
// An address that ends in #12.5, a frame with the name 12.5 or the message 12.5 shows the moment 12.5 s.
"use strict";
const { title, summary, times, poses, pillars, marks, pillar: pillarRadius, robot } = JSON.parse(document.getElementById("data").textContent);
const [canvas, slider, output, play, speed, view] = ["canvas", "input", "output", "#play", "select", "#view"].map((s) => document.querySelector(s));
const end = times[times.length - 1];
const HOME = { turn: 0.3, height: 0.3, distance: 6 }, camera = { ...HOME }; // [rad] angle around the robot, [rad] elevation, [m]
let now = times[0], playing = window === top, last = null; // in another page it waits for a message
document.title = document.querySelector("header b").textContent = title;
document.querySelector("header span").textContent = summary;
slider.min = times[0]; slider.max = end;

const mix = (a, b, s) => a + s * (b - a);
const rowAt = (t) => { // row, next row, and the fraction of the way between them
  let low = 0, high = times.length - 1;
  while (high - low > 1) { const middle = (low + high) >> 1; if (times[middle] <= t) low = middle; else high = middle; }
  const span = times[high] - times[low];
  return [low, high, span > 0 ? Math.min(Math.max((t - times[low]) / span, 0), 1) : 0];
};
const turned = (a, b) => Math.atan2(Math.sin(b - a), Math.cos(b - a));
const poseAt = (t) => {
  const [low, high, s] = rowAt(t), a = poses[low], b = poses[high];
  return [mix(a[0], b[0], s), mix(a[1], b[1], s), a[2] + s * turned(a[2], b[2])];
};
const rolled = [[0, 0]]; // [m] distance on the ground that the left and right wheels have rolled
for (let i = 1; i < poses.length; i++) {
  const [x, y, yaw] = poses[i - 1], [u, v] = poses[i], turn = turned(yaw, poses[i][2]) * robot.track / 2;
  const ahead = (u - x) * Math.cos(yaw) + (v - y) * Math.sin(yaw), [left, right] = rolled[i - 1];
  rolled.push([left + ahead - turn, right + ahead + turn]);
}

// ---------------------------------------------------------------------------- drawing
const gl = canvas.getContext("webgl2");
if (!gl) document.querySelector("header span").textContent = "this browser draws no WebGL 2, so the drive cannot be shown";
const VERTEX = `#version 300 es
in vec3 p; uniform mat4 model, view; out vec3 w;
void main() { w = (model * vec4(p, 1.)).xyz; gl_Position = view * vec4(w, 1.); }`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 w; out vec4 o; uniform vec4 color; uniform int kind; uniform vec3 eye, sky, ground, grid; uniform vec4 pose; uniform vec2 size; uniform vec3 post;
float lines(float step, float wide) { vec2 g = abs(fract(w.xy / step - .5) - .5) * step, f = fwidth(w.xy) * wide; vec2 l = 1. - smoothstep(f * .5, f * 1.5, g); return max(l.x, l.y) * clamp(1. - max(f.x, f.y) / step * 2., 0., 1.); }
void main() {
  if (kind == 1) {
    vec2 d = w.xy - pose.xy; d = vec2(pose.z * d.x + pose.w * d.y, pose.z * d.y - pose.w * d.x);
    float far = length(w.xy - eye.xy), a = length(max(abs(d) - size * vec2(.8, .85), 0.)), b = max(length(w.xy - post.xy) - post.z, 0.);
    vec3 c = mix(ground, grid, .4 * lines(1., .7) + .6 * lines(5., 1.));
    c *= 1. - .5 * exp(-a * a * 40.) - .35 * step(.01, post.z) * exp(-b * b * 20.);
    o = vec4(mix(c, sky, smoothstep(15., 70., far)), 1.);
  } else if (kind == 2) o = color;
  else {
    vec3 n = normalize(cross(dFdx(w), dFdy(w))); n = dot(n, eye - w) < 0. ? -n : n;
    o = vec4(color.rgb * (.74 + .16 * n.z + .26 * max(dot(n, vec3(.36, -.48, .8)), 0.)), 1.);
  }
}`;
const program = gl && gl.createProgram();
const uniform = {};
if (gl) {
  [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]].forEach(([kind, text]) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(program, shader);
  });
  gl.bindAttribLocation(program, 0, "p"); gl.linkProgram(program); gl.useProgram(program);
  "model view color kind eye sky ground grid pose size post".split(" ").forEach((name) => { uniform[name] = gl.getUniformLocation(program, name); });
  gl.enableVertexAttribArray(0); gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
}
const rgb = (color) => [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16) / 255);
const upload = (array) => {
  const buffer = gl.createBuffer();
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer); gl.bufferData(gl.ARRAY_BUFFER, array, gl.STATIC_DRAW);
  return buffer;
};
const part = ([color, text]) => { // mesh of a part of the robot, from numbers in millimetres
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)), array = new Int16Array(bytes.buffer);
  return { color: rgb(color), buffer: upload(array), count: array.length / 3 };
};
const SIDES = 32;
const column = () => { // mesh of a cylinder of radius and height 1
  const at = (i, z) => [Math.cos(2 * Math.PI * i / SIDES), Math.sin(2 * Math.PI * i / SIDES), z];
  const all = Array.from({ length: SIDES }, (_, i) => [at(i, 0), at(i + 1, 0), at(i + 1, 1), at(i, 0), at(i + 1, 1), at(i, 1), [0, 0, 1], at(i, 1), at(i + 1, 1)]);
  return { buffer: upload(new Float32Array(all.flat(2))), count: 9 * SIDES };
};
const [body, tyre, post, loose] = gl ? [robot.body.map(part), robot.tyre.map(part), column(), gl.createBuffer()] : [];
const placed = (x, y, z, yaw, roll, sx, sy, sz) => { // matrix that scales, turns around y, then around z, and moves
  const c = Math.cos(yaw), s = Math.sin(yaw), a = Math.cos(roll), b = Math.sin(roll);
  return [sx * c * a, sx * s * a, -sx * b, 0, -sy * s, sy * c, 0, 0, sz * c * b, sz * s * b, sz * a, 0, x, y, z, 1];
};
const solid = ({ buffer, count }, color, model, type) => {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.vertexAttribPointer(0, 3, type, false, 0, 0);
  gl.uniformMatrix4fv(uniform.model, false, model); gl.uniform4f(uniform.color, ...color, 1);
  gl.drawArrays(gl.TRIANGLES, 0, count);
};
const FLAT = placed(0, 0, 0, 0, 0, 1, 1, 1);
const flat = (mode, points, color, alpha, kind) => { // marks on the ground, drawn above others
  gl.bindBuffer(gl.ARRAY_BUFFER, loose); gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(points), gl.DYNAMIC_DRAW);
  gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
  gl.uniform1i(uniform.kind, kind); gl.uniformMatrix4fv(uniform.model, false, FLAT); gl.uniform4f(uniform.color, ...color, alpha);
  gl.drawArrays(mode, 0, points.length / 3);
};
const ribbon = (until, pose, width) => { // driven path
  const rows = [...poses.slice(0, rowAt(until)[0] + 1), pose], points = [];
  rows.forEach(([x, y], i) => {
    const a = rows[Math.max(i - 1, 0)], b = rows[Math.min(i + 1, rows.length - 1)], gap = Math.hypot(b[0] - a[0], b[1] - a[1]);
    if (gap < 1e-3 && i) return;
    const nx = -width * (b[1] - a[1]) / (gap || 1), ny = width * (b[0] - a[0]) / (gap || 1);
    points.push(x + nx, y + ny, 0, x - nx, y - ny, 0);
  });
  return points;
};
const look = (target, turn) => { // matrix from world to clip space, column by column
  const c = Math.cos(camera.height), s = Math.sin(camera.height), cos = Math.cos(turn), sin = Math.sin(turn), near = 0.3, far = 500;
  const ahead = [c * cos, c * sin, -s], right = [sin, -cos, 0], up = [s * cos, s * sin, c];
  const eye = target.map((value, i) => value - camera.distance * ahead[i]);
  const dot = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
  const zoom = 3 * Math.min(1, 1.1 * canvas.width / canvas.height), wide = zoom * canvas.height / canvas.width, k = (far + near) / (far - near);
  return [eye, [0, 1, 2].flatMap((i) => [wide * right[i], zoom * up[i], k * ahead[i], ahead[i]]).concat(-wide * dot(right), -zoom * dot(up), -k * dot(ahead) - 2 * far * near / (far - near), -dot(ahead))];
};
const draw = () => {
  const pose = poseAt(now), row = rowAt(now), pillar = pillars.length === 1 ? pillars[0] : pillars[row[0]];
  const a = poseAt(now - 0.2), b = poseAt(now + 0.2), span = Math.min(now + 0.2, end) - Math.max(now - 0.2, times[0]);
  const gap = pillar ? `, ${Math.max(Math.hypot(pillar[0] - pose[0], pillar[1] - pose[1]) - pillarRadius, 0).toFixed(2)} m to the pillar` : "";
  output.value = `${now.toFixed(2)} s, ${(Math.hypot(b[0] - a[0], b[1] - a[1]) / Math.max(span, 1e-6)).toFixed(2)} m/s${gap}`;
  slider.value = now;
  play.textContent = playing ? "Pause" : "Play";
  if (!gl) return;
  const ratio = devicePixelRatio || 1, dark = matchMedia("(prefers-color-scheme: dark)").matches;
  canvas.width = canvas.clientWidth * ratio; canvas.height = canvas.clientHeight * ratio;
  gl.viewport(0, 0, canvas.width, canvas.height);
  const [sky, ground, grid] = (dark ? ["#1b2430", "#23282e", "#46505a"] : ["#dce6ef", "#f1f2f0", "#b9bfc4"]).map(rgb);
  gl.clearColor(...sky, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
  let behind = 0; // mean turn of the last second, so the camera follows smoothly
  for (let i = 0; i < 10; i++) behind += turned(pose[2], poseAt(now - i * 0.15)[2]) / 10;
  const above = view.value === "above", [eye, matrix] = look([pose[0], pose[1], 0.3], above ? Math.PI / 2 + camera.turn - HOME.turn : pose[2] + behind + camera.turn);
  gl.uniformMatrix4fv(uniform.view, false, matrix);
  [["eye", eye], ["sky", sky], ["ground", ground], ["grid", grid]].forEach(([name, value]) => gl.uniform3f(uniform[name], ...value));
  gl.uniform4f(uniform.pose, pose[0], pose[1], Math.cos(pose[2]), Math.sin(pose[2]));
  gl.uniform2f(uniform.size, ...robot.size);
  gl.uniform3f(uniform.post, ...(pillar ? [...pillar, pillarRadius] : [0, 0, 0]));
  gl.disable(gl.DEPTH_TEST);
  const [x, y] = pose, R = 300;
  flat(gl.TRIANGLE_STRIP, [x - R, y - R, 0, x + R, y - R, 0, x - R, y + R, 0, x + R, y + R, 0], ground, 1, 1);
  const thin = Math.max(0.004 * camera.distance, 0.012);
  flat(gl.TRIANGLE_STRIP, ribbon(now, pose, thin), rgb("#1f78d1"), 0.9, 2);
  const seen = marks.filter((mark) => mark[0] <= now), wide = 2 * thin;
  flat(gl.TRIANGLES, seen.flatMap(([, u, v]) => [u - wide, v, 0, u, v - wide, 0, u + wide, v, 0, u - wide, v, 0, u + wide, v, 0, u, v + wide, 0]), rgb("#ff7300"), 0.6, 2);
  gl.enable(gl.DEPTH_TEST); gl.uniform1i(uniform.kind, 0);
  const [length, side, axle, radius] = robot.wheel, mm = 0.001, c = Math.cos(pose[2]), s = Math.sin(pose[2]);
  body.forEach((each) => solid(each, each.color, placed(x, y, robot.height, pose[2], 0, mm, mm, mm), gl.SHORT));
  [[length, side, 0], [-length, side, 0], [length, -side, 1], [-length, -side, 1]].forEach(([dx, dy, which]) => {
    const roll = mix(rolled[row[0]][which], rolled[row[1]][which], row[2]) / radius;
    tyre.forEach((each) => solid(each, each.color, placed(x + c * dx - s * dy, y + s * dx + c * dy, robot.height + axle, pose[2], roll, mm, mm, mm), gl.SHORT));
  });
  if (pillar) solid(post, rgb("#a9afb5"), placed(...pillar, 0, 0, 0, pillarRadius, pillarRadius, 1.5), gl.FLOAT);
  if (pillar && seen.length) solid(post, rgb("#ff7300"), placed(...seen[seen.length - 1].slice(1), 0, 0, 0, 0.07, 0.07, 1.9), gl.FLOAT);
};

// ---------------------------------------------------------------------------- time and user input
const seek = (moment) => { if (Number.isFinite(moment)) { now = Math.min(Math.max(moment, times[0]), end); playing = false; draw(); } };
const tick = (moment) => {
  if (playing && last !== null) {
    const passed = Math.min((moment - last) / 1000, 0.25); // a slow picture must not skip a part of the run
    now = Math.min(now + Number(speed.value) * passed, end);
    if (now >= end) playing = false;
    draw();
  }
  last = moment;
  requestAnimationFrame(tick);
};
play.onclick = () => { if (!playing && now >= end) now = times[0]; playing = !playing; draw(); };
slider.oninput = () => seek(Number(slider.value));
view.onchange = () => { [camera.height, camera.distance] = view.value === "above" ? [1.5, 28] : [HOME.height, HOME.distance]; draw(); };
addEventListener("keydown", (event) => { if (event.code === "Space" && event.target === document.body) { event.preventDefault(); play.click(); } });
addEventListener("resize", draw);
addEventListener("hashchange", () => seek(parseFloat(location.hash.slice(1))));
addEventListener("message", (event) => seek(parseFloat(event.data)));
const fingers = new Map();
canvas.onpointerdown = (event) => { fingers.set(event.pointerId, [event.clientX, event.clientY]); canvas.setPointerCapture(event.pointerId); };
canvas.onpointerup = canvas.onpointercancel = (event) => fingers.delete(event.pointerId);
const zoom = (factor) => { camera.distance = Math.min(Math.max(camera.distance * factor, 2), 60); };
canvas.onpointermove = (event) => {
  const before = fingers.get(event.pointerId);
  if (before === undefined) return;
  const others = [...fingers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
  if (others.length) {
    const [x, y] = others[0], gap = (p) => Math.hypot(p[0] - x, p[1] - y);
    zoom(gap(before) / Math.max(gap([event.clientX, event.clientY]), 1));
  } else {
    camera.turn -= 0.008 * (event.clientX - before[0]);
    camera.height = Math.min(Math.max(camera.height + 0.006 * (event.clientY - before[1]), 0.05), 1.55);
  }
  fingers.set(event.pointerId, [event.clientX, event.clientY]);
  draw();
};
canvas.addEventListener("wheel", (event) => { event.preventDefault(); zoom(Math.exp(0.001 * event.deltaY)); draw(); }, { passive: false });
draw();
seek(parseFloat(location.hash.slice(1) || name));
requestAnimationFrame(tick);
