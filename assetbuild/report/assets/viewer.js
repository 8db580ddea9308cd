// The report's 3D view: a robot that is posed by sliders. Needs three.js (THREE) and two JSON
// blocks of the page: #viewer-geometry (meshes, shapes) and #viewer-robot (bodies, joints, poses).
"use strict";
window.assetbuildReady = (async function () {
  const root = document.getElementById("viewer");
  if (!root) return;
  const canvas = root.querySelector("canvas");
  const note = root.querySelector(".viewer-note");
  const read = (id) => JSON.parse(document.getElementById(id).textContent);
  const robot = read("viewer-robot");
  let geometry;
  try {
    const packed = new Blob([bytes(read("viewer-geometry").gzip)]).stream();
    geometry = await new Response(packed.pipeThrough(new DecompressionStream("gzip"))).json();
  } catch (error) {
    root.classList.add("no-webgl");
    note.textContent = "This browser cannot unpack the 3D view: `assetbuild report BUNDLE --pictures DIR` draws pictures.";
    return;
  }

  // --- decoding -----------------------------------------------------------------------------

  function bytes(text) {
    const raw = atob(text);
    const out = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) out[i] = raw.charCodeAt(i);
    return out;
  }

  function meshGeometry(row) {
    const packed = new Uint16Array(bytes(row.points).buffer);
    const points = new Float32Array(packed.length);
    for (let i = 0; i < packed.length; i++) {
      points[i] = row.lower[i % 3] + (row.size[i % 3] * packed[i]) / 65535;
    }
    const Faces = row.wide ? Uint32Array : Uint16Array;
    return creased(points, new Faces(bytes(row.faces).buffer));
  }

  const CREASE = Math.cos((35 * Math.PI) / 180);

  // Smooth where faces meet at less than the crease angle, sharp where they meet at more.
  function creased(points, corners) {
    const faces = corners.length / 3, count = points.length / 3;
    const normals = new Float32Array(corners.length); // of the faces; as long as twice their area
    const units = new Float32Array(corners.length);
    const starts = new Uint32Array(count + 1);
    for (let f = 0; f < faces; f++) {
      const [a, b, c] = [3 * corners[3 * f], 3 * corners[3 * f + 1], 3 * corners[3 * f + 2]];
      const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
      const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
      const n = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
      const long = Math.hypot(...n) || 1;
      for (let i = 0; i < 3; i++) {
        normals[3 * f + i] = n[i];
        units[3 * f + i] = n[i] / long;
        starts[corners[3 * f + i] + 1]++;
      }
    }
    for (let v = 0; v < count; v++) starts[v + 1] += starts[v];
    const around = new Uint32Array(corners.length), filled = starts.slice();
    for (let i = 0; i < corners.length; i++) around[filled[corners[i]]++] = (i / 3) | 0;
    const places = new Float32Array(3 * corners.length), smooth = new Float32Array(3 * corners.length);
    for (let i = 0; i < corners.length; i++) {
      const v = corners[i], own = 3 * ((i / 3) | 0);
      let x = 0, y = 0, z = 0;
      for (let k = starts[v]; k < starts[v + 1]; k++) {
        const f = 3 * around[k];
        const turn = units[f] * units[own] + units[f + 1] * units[own + 1] + units[f + 2] * units[own + 2];
        if (turn < CREASE) continue;
        x += normals[f]; y += normals[f + 1]; z += normals[f + 2];
      }
      const long = Math.hypot(x, y, z) || 1;
      smooth[3 * i] = x / long; smooth[3 * i + 1] = y / long; smooth[3 * i + 2] = z / long;
      for (let j = 0; j < 3; j++) places[3 * i + j] = points[3 * v + j];
    }
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(places, 3));
    made.setAttribute("normal", new THREE.BufferAttribute(smooth, 3));
    made.userData.corners = corners;
    return made;
  }

  function primitiveGeometry(shape) {
    const [a, b, c] = shape.dims;
    let made;
    if (shape.kind === "box") made = new THREE.BoxGeometry(a, b, c);
    else if (shape.kind === "sphere") made = new THREE.SphereGeometry(a, 24, 16);
    else {
      const make = shape.kind === "capsule" ? THREE.CapsuleGeometry : null;
      made = make ? new make(a, b, 8, 20) : new THREE.CylinderGeometry(a, a, b, 28);
      made.rotateX(Math.PI / 2); // three's axis is y, ours is z
    }
    return made;
  }

  function place(object, xyz, quat) {
    object.position.set(xyz[0], xyz[1], xyz[2]);
    object.quaternion.set(quat[1], quat[2], quat[3], quat[0]);
    return object;
  }

  // Red: the visual surface is not covered. Blue: collision lies in front of it. White: they meet.
  function distanceColours(text, corners) {
    const values = bytes(text);
    const colours = new Float32Array(corners.length * 3);
    for (let i = 0; i < corners.length; i++) {
      const t = Math.max(-1, Math.min(1, (values[corners[i]] - 128) / 127));
      const fade = 1 - Math.abs(t);
      colours[3 * i] = t > 0 ? 0.85 : 0.15 + 0.75 * fade;
      colours[3 * i + 1] = 0.12 + 0.78 * fade;
      colours[3 * i + 2] = t > 0 ? 0.1 + 0.8 * fade : 0.85;
    }
    return new THREE.BufferAttribute(colours, 3);
  }

  const hue = (n) => new THREE.Color().setHSL((n * 0.618034) % 1, 0.6, 0.55);

  // --- the scene ----------------------------------------------------------------------------

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
  } catch (error) {
    root.classList.add("no-webgl");
    note.textContent = "This browser has no WebGL: `assetbuild report BUNDLE --pictures DIR` draws pictures.";
    return;
  }
  renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
  if ("outputEncoding" in renderer) renderer.outputEncoding = THREE.sRGBEncoding;
  const scene = new THREE.Scene();
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFSoftShadowMap;
  // Together they light a white surface just below full brightness, so that its form shows.
  const sky = new THREE.HemisphereLight(0xffffff, 0x707880, 0.35);
  sky.position.set(0, 0, 1);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.5);
  lamp.castShadow = true;
  lamp.shadow.mapSize.set(1024, 1024);
  lamp.shadow.radius = 4;
  const fill = new THREE.DirectionalLight(0xffffff, 0.12);
  scene.add(sky, lamp, lamp.target, fill);
  const camera = new THREE.PerspectiveCamera(40, 4 / 3, 0.01, 200);
  camera.up.set(0, 0, 1);

  const base = new THREE.Group();
  scene.add(base);
  const bodies = {};
  for (const body of robot.bodies) {
    bodies[body.name] = Object.assign(new THREE.Group(), { name: body.name });
  }
  base.add(bodies[robot.root]);
  const joints = {};
  for (const joint of robot.joints) {
    const mount = place(new THREE.Group(), joint.xyz, joint.quat);
    bodies[joint.parent].add(mount);
    mount.add(bodies[joint.child]);
    joints[joint.name] = Object.assign({}, joint, { value: 0, moved: bodies[joint.child] });
  }

  const layers = { visual: [], collision: [], inertia: [], frames: [], axes: [] };
  const cache = {};
  const lambert = (options) =>
    new THREE.MeshStandardMaterial(
      Object.assign({ roughness: 0.7, metalness: 0, side: 2 }, options)
    );

  geometry.shapes.forEach((shape, number) => {
    const isMesh = shape.kind === "mesh";
    if (isMesh && !cache[shape.mesh]) cache[shape.mesh] = meshGeometry(geometry.meshes[shape.mesh]);
    let form = isMesh ? cache[shape.mesh] : primitiveGeometry(shape);
    if (shape.distance) {
      const { corners } = form.userData;
      form = form.clone();
      form.setAttribute("color", distanceColours(shape.distance, corners));
    }
    const collision = shape.role === "collision";
    const [r, g, b, a] = shape.rgba;
    const own = collision ? hue(number) : new THREE.Color(r, g, b).convertSRGBToLinear();
    const alpha = collision ? 0.55 : a;
    const material = lambert({ color: own, opacity: alpha, transparent: alpha < 1 });
    const object = place(new THREE.Mesh(form, material), shape.xyz, shape.quat);
    object.userData = { body: shape.body, shape, own: own.clone(), alpha };
    object.castShadow = !collision && alpha >= 1;
    bodies[shape.body].add(object);
    layers[shape.role].push(object);
  });

  for (const body of robot.bodies) {
    if (body.ellipsoid) {
      const ball = new THREE.SphereGeometry(1, 20, 14);
      const skin = lambert({ color: 0xd2503c, opacity: 0.55, transparent: true });
      const object = place(new THREE.Mesh(ball, skin), body.com, body.ellipsoid.quat);
      object.scale.set(...body.ellipsoid.axes.map((v) => Math.max(v, 1e-4)));
      object.userData = { body: body.name };
      bodies[body.name].add(object);
      layers.inertia.push(object);
      const dot = new THREE.SphereGeometry(0.008 * robot.size, 12, 8);
      const mass = new THREE.Mesh(dot, new THREE.MeshBasicMaterial({ color: 0x111111 }));
      place(mass, body.com, [1, 0, 0, 0]);
      bodies[body.name].add(mass);
      layers.inertia.push(mass);
    }
    const cross = new THREE.AxesHelper(0.12 * robot.size);
    bodies[body.name].add(cross);
    layers.frames.push(cross);
  }
  for (const joint of robot.joints) {
    if (!joint.axis) continue;
    const along = new THREE.Vector3(...joint.axis);
    const arrow = new THREE.ArrowHelper(along, new THREE.Vector3(), 0.16 * robot.size, 0x1d6fd6);
    bodies[joint.child].add(arrow);
    layers.axes.push(arrow);
  }
  const grid = new THREE.GridHelper(4, 40, 0x888888, 0x888888);
  grid.rotateX(Math.PI / 2);
  grid.material.opacity = 0.25;
  grid.material.transparent = true;
  scene.add(grid);
  const shade = new THREE.Mesh(new THREE.PlaneGeometry(1, 1), new THREE.ShadowMaterial({ opacity: 0.28 }));
  shade.receiveShadow = true;
  scene.add(shade);

  // --- posing -------------------------------------------------------------------------------

  const sliders = {};

  function setJoint(name, value) {
    const joint = joints[name];
    joint.value = value;
    const axis = new THREE.Vector3(...joint.axis);
    if (joint.kind === "prismatic") joint.moved.position.copy(axis.multiplyScalar(value));
    else joint.moved.quaternion.setFromAxisAngle(axis, value);
    const slider = sliders[name];
    if (slider) {
      slider.input.value = value;
      slider.output.textContent = `${(Math.round(value * 1000) / 1000 + 0).toFixed(3)} ${joint.unit}`;
    }
    for (const other of Object.values(joints)) {
      if (other.mimic && other.mimic.joint === name) {
        setJoint(other.name, other.mimic.offset + other.mimic.multiplier * value);
      }
    }
  }

  function setPose(pose) {
    place(base, pose.xyz, pose.quat);
    for (const joint of robot.joints) {
      if (joint.axis && !joint.mimic) setJoint(joint.name, pose.joints[joint.name] || 0);
    }
    draw();
  }

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...children);
    return made;
  }

  const list = root.querySelector(".viewer-joints");
  for (const joint of robot.joints) {
    if (!joint.axis) continue;
    const id = `joint-${joint.name}`;
    const input = element("input", {
      type: "range", id, min: joint.lower, max: joint.upper, step: (joint.upper - joint.lower) / 400 || 0.001,
    });
    const output = element("output", { for: id });
    const range = `${joint.lower.toFixed(2)} to ${joint.upper.toFixed(2)} ${joint.unit}`;
    input.setAttribute("aria-description", range);
    input.title = range;
    if (joint.mimic) input.disabled = true;
    input.addEventListener("input", () => {
      setJoint(joint.name, Number(input.value));
      draw();
    });
    sliders[joint.name] = { input, output };
    list.append(element("div", { class: "slider" },
      element("label", { for: id }, joint.name), output, input));
  }

  const poses = root.querySelector(".viewer-poses");
  for (const pose of robot.poses) {
    const button = element("button", { type: "button" }, pose.name);
    button.addEventListener("click", () => setPose(pose));
    poses.append(button);
  }

  // --- switches, colours, names -------------------------------------------------------------

  const shown = {};
  for (const box of root.querySelectorAll("input[data-layer]")) {
    const name = box.dataset.layer;
    if (name === "collision") box.checked = !layers.visual.length;
    const apply = () => {
      shown[name] = box.checked;
      for (const object of layers[name] || []) object.visible = box.checked;
      draw();
    };
    box.addEventListener("change", apply);
    shown[name] = box.checked;
    for (const object of layers[name] || []) object.visible = box.checked;
  }

  const colour = root.querySelector("select[data-colour]");
  const legend = root.querySelector(".viewer-legend");
  colour.addEventListener("change", () => {
    paint();
    draw();
  });

  let chosen = null;

  function paint() {
    const distance = colour.value === "distance";
    legend.hidden = !distance;
    for (const object of layers.visual.concat(layers.collision)) {
      const { shape, own, alpha, body } = object.userData;
      const material = object.material;
      const far = distance && shape.role === "visual";
      material.vertexColors = Boolean(far && shape.distance);
      material.color.copy(far ? new THREE.Color(shape.distance ? 0xffffff : 0x9aa0a6) : own);
      material.opacity = far ? 1 : alpha;
      material.transparent = material.opacity < 1;
      material.emissive.set(chosen === body ? 0x2a3f66 : 0);
      material.needsUpdate = true;
    }
  }

  const labels = root.querySelector(".viewer-labels");
  const spans = robot.bodies.map((body) => {
    const span = element("span", {}, body.name);
    labels.append(span);
    return { span, body: bodies[body.name] };
  });

  function drawNames() {
    labels.hidden = !shown.names;
    if (!shown.names) return;
    const point = new THREE.Vector3();
    for (const { span, body } of spans) {
      body.getWorldPosition(point).project(camera);
      span.style.left = `${(50 * (point.x + 1)).toFixed(2)}%`;
      span.style.top = `${(50 * (1 - point.y)).toFixed(2)}%`;
    }
  }

  // --- one link's numbers -------------------------------------------------------------------

  const picker = root.querySelector("select[data-link]");
  const facts = root.querySelector(".viewer-facts");
  for (const body of robot.bodies) picker.append(element("option", { value: body.name }, body.name));
  picker.addEventListener("change", () => choose(picker.value || null));

  function choose(name) {
    chosen = name;
    picker.value = name || "";
    facts.replaceChildren();
    const body = robot.bodies.find((each) => each.name === name);
    for (const [key, value] of body ? body.facts : []) {
      facts.append(element("dt", {}, key), element("dd", {}, value));
    }
    paint();
    draw();
  }

  function pick(event) {
    const box = canvas.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * 2 - 1;
    const y = 1 - ((event.clientY - box.top) / box.height) * 2;
    const ray = new THREE.Raycaster();
    ray.setFromCamera(new THREE.Vector2(x, y), camera);
    const targets = [...layers.visual, ...layers.collision, ...layers.inertia];
    const hits = ray.intersectObjects(targets.filter((o) => o.visible && o.userData.body), false);
    choose(hits.length ? hits[0].object.userData.body : null);
  }

  // --- camera -------------------------------------------------------------------------------

  const eye = { azimuth: -0.7, elevation: 0.32, distance: 1, target: new THREE.Vector3() };

  function frameAll() {
    scene.updateMatrixWorld(true);
    const box = new THREE.Box3();
    for (const object of layers.visual.concat(layers.collision)) box.expandByObject(object);
    if (box.isEmpty()) box.setFromObject(base);
    const ball = box.getBoundingSphere(new THREE.Sphere());
    eye.target.copy(ball.center);
    eye.distance = Math.max(ball.radius, 0.02) * 3;
    grid.visible = robot.floating;
    const reach = ball.radius;
    shade.position.set(ball.center.x, ball.center.y, box.min.z - 1e-3 * reach);
    shade.scale.set(12 * reach, 12 * reach, 1);
    lamp.target.position.copy(ball.center);
    lamp.position.copy(ball.center).add(new THREE.Vector3(reach, -1.6 * reach, 4 * reach));
    lamp.shadow.bias = -0.002;
    lamp.shadow.normalBias = 0.004 * reach;
    Object.assign(lamp.shadow.camera, {
      left: -1.5 * reach, right: 1.5 * reach, top: 1.5 * reach, bottom: -1.5 * reach,
      near: 0.5 * reach, far: 9 * reach,
    });
    lamp.shadow.camera.updateProjectionMatrix();
  }

  function draw() {
    requestAnimationFrame(render);
  }

  let stamp = 0;
  function render() {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    const ratio = renderer.getPixelRatio();
    if (canvas.width !== Math.floor(width * ratio) || canvas.height !== Math.floor(height * ratio)) {
      renderer.setSize(width, height, false);
    }
    camera.aspect = width / height;
    camera.near = eye.distance / 100;
    camera.far = eye.distance * 50;
    camera.updateProjectionMatrix();
    const flat = Math.cos(eye.elevation) * eye.distance;
    camera.position.set(
      eye.target.x + flat * Math.cos(eye.azimuth),
      eye.target.y + flat * Math.sin(eye.azimuth),
      eye.target.z + Math.sin(eye.elevation) * eye.distance
    );
    camera.lookAt(eye.target);
    fill.position.copy(camera.position).sub(eye.target);
    renderer.render(scene, camera);
    drawNames();
    root.dataset.frames = String(++stamp);
  }

  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    drag = { x: event.clientX, y: event.clientY, far: 0, pan: event.button === 2 || event.shiftKey };
    canvas.setPointerCapture(event.pointerId);
    canvas.focus({ preventScroll: true });
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const dx = event.clientX - drag.x, dy = event.clientY - drag.y;
    drag.far += Math.abs(dx) + Math.abs(dy);
    Object.assign(drag, { x: event.clientX, y: event.clientY });
    if (drag.pan) pan(dx, dy);
    else turn(-dx * 0.008, dy * 0.008);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (drag && drag.far < 4) pick(event);
    drag = null;
  });
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    if (document.activeElement !== canvas) return; // the page scrolls until the view is clicked
    event.preventDefault();
    zoom(Math.exp(event.deltaY * 0.001));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const moves = {
      ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
      ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
      "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1.1),
    };
    if (!moves[event.key]) return;
    event.preventDefault();
    moves[event.key]();
  });

  function turn(azimuth, elevation) {
    eye.azimuth += azimuth;
    eye.elevation = Math.max(-1.5, Math.min(1.5, eye.elevation + elevation));
    draw();
  }
  function zoom(factor) {
    eye.distance *= factor;
    draw();
  }
  function pan(dx, dy) {
    const step = (eye.distance / canvas.clientHeight) * 0.75;
    const right = new THREE.Vector3().setFromMatrixColumn(camera.matrix, 0);
    const up = new THREE.Vector3().setFromMatrixColumn(camera.matrix, 1);
    eye.target.addScaledVector(right, -dx * step).addScaledVector(up, dy * step);
    draw();
  }

  new ResizeObserver(draw).observe(canvas);
  setPose(robot.poses[0]);
  frameAll();
  paint();
  draw();
  root.dataset.ready = "true";

  // For tests and for the console: poses in the world, as three.js computed them.
  window.assetbuildViewer = {
    setJoint: (name, value) => { setJoint(name, value); draw(); },
    choose,
    worldPosition: (body) => {
      scene.updateMatrixWorld(true);
      return bodies[body].getWorldPosition(new THREE.Vector3()).toArray();
    },
  };
})();
