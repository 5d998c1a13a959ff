// The machine in 3-D, drawn by three.js.
"use strict";

const GHOST = { color: 0x8899aa, transparent: true, opacity: 0.35, depthWrite: false };

class View {
  constructor(parent, record, full) {
    this.record = record;
    this.parent = parent;
    this.renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    parent.appendChild(this.renderer.domElement);
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 0.05, 2000);
    this.camera.up.set(0, 0, 1);
    this.controls = new THREE.OrbitControls(this.camera, this.renderer.domElement);
    this.controls.addEventListener("change", () => this.render());
    this.lights();
    this.ground = new THREE.Group();
    this.ground.quaternion.fromArray(record.ground.rotation);
    this.scene.add(this.ground);
    this.measure();
    this.addGround();
    this.plan = this.addMachine(record.plan, null);
    this.addMass();
    this.addTrail(record.plan, full);
    this.tint(record.broken);
    this.blind = record.blind && this.addMachine(record.blind, GHOST);
    this.controls.addEventListener("start", () => { this.turned = true; });
    new ResizeObserver(() => this.resize()).observe(parent);
    this.preset("corner");
  }

  // Show another motion of this machine, on a slope that may be another; the camera stays.
  update(record, full) {
    this.record = record;
    this.ground.quaternion.fromArray(record.ground.rotation);
    this.plan.motion = record.plan;
    this.addPayloads(this.plan, record.parts.filter((part) => part.payload));
    this.addTrail(record.plan, full);
    this.tint(record.broken);
    if (!this.turned && this.grow()) this.preset(this.looks);
  }

  // Take in what reaches beyond what was measured before; returns whether it is much.
  grow() {
    const { low, high, size } = this;
    this.measure();
    const far = Math.max(...low.map((entry, i) => Math.max(entry - this.low[i], this.high[i] - high[i])));
    this.low = low.map((entry, i) => Math.min(entry, this.low[i]));
    this.high = high.map((entry, i) => Math.max(entry, this.high[i]));
    this.size = size; // of the ground and the marks, which stay
    return far > 0.02 * size;
  }

  // Redden a machine whose motion is not safe.
  tint(broken) {
    for (const { material, colour } of this.plan.materials) material.color.copy(colour).lerp(new THREE.Color(COLOURS.out), broken ? 0.65 : 0);
  }

  lights() {
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x8a8f98, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.8);
    sun.position.set(3, -5, 9);
    this.scene.add(sun);
  }

  // Size of all that moves, in the ground frame, and where its middle is.
  measure() {
    const { plan } = this.record, low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    const reach = this.record.parts.map(reachOf);
    const step = Math.max(1, Math.floor(plan.times.length / 40));
    for (let i = 0; i < plan.times.length; i += step) {
      const root = placed(poseOf(plan.root, i));
      this.record.parts.forEach((part, k) => {
        const poses = plan.bodies[part.joint], at = placed(poseOf(poses, i)).premultiply(root).multiply(placed(part.pose));
        const middle = new THREE.Vector3().setFromMatrixPosition(at).toArray();
        middle.forEach((entry, axis) => { low[axis] = Math.min(low[axis], entry - 0.7 * reach[k]); high[axis] = Math.max(high[axis], entry + 0.7 * reach[k]); });
      });
    }
    this.low = low; this.high = high;
    // a ghost that drives has its place on the ground
    this.beside = this.record.blind && this.record.blind.root.length === 1 ? 0.75 * (high[1] - low[1]) : 0;
    this.size = Math.max(...high.map((entry, i) => entry - low[i]));
  }

  addGround() {
    const { ground } = this.record, grid = [];
    const material = new THREE.MeshLambertMaterial({ color: 0xb9ad98, side: THREE.DoubleSide });
    if (ground.heights) { this.ground.add(new THREE.Mesh(terrain(ground, grid), material)); }
    else {
      const cell = 10 ** Math.round(Math.log10(this.size / 8)), reach = Math.ceil((0.9 * this.size + this.beside) / cell) * cell;
      const plane = new THREE.Mesh(new THREE.PlaneGeometry(2 * reach, 2 * reach), material);
      plane.position.z = -0.004 * this.size;
      this.ground.add(plane);
      for (let k = -reach; k <= reach + 1e-9; k += cell) grid.push(-reach, k, 0, reach, k, 0, k, -reach, 0, k, reach, 0);
    }
    const lines = new THREE.BufferGeometry().setAttribute("position", new THREE.BufferAttribute(new Float32Array(grid), 3));
    const mesh = new THREE.LineSegments(lines, new THREE.LineBasicMaterial({ color: 0x8f8571 }));
    mesh.position.z = (ground.heights ? 0.004 : -0.002) * this.size;
    this.ground.add(mesh);
  }

  addMachine(motion, ghost) {
    const root = new THREE.Group(), { support } = this.record, machine = { motion, root, bodies: {}, materials: [], loads: [], drawn: null, ghost };
    for (const part of this.record.parts) if (!part.payload) this.addPart(machine, part);
    this.addPayloads(machine, this.record.parts.filter((part) => part.payload));
    // what lies on the ground stays there while a ghost falls over
    const rest = ghost ? new THREE.Group() : root;
    if (ghost) rest.applyMatrix4(placed(motion.root[0]));
    const marker = new THREE.Mesh(new THREE.SphereGeometry(0.013 * this.size, 20, 14), overlay({ color: ghost ? 0x8899aa : 0xf0e442 }));
    marker.renderOrder = 4;
    rest.add(marker);
    if (support) rest.add(outline(support, ghost ? 0x8899aa : 0x000000, 0.005 * this.size));
    const shift = new THREE.Group();
    if (ghost) shift.position.y = this.beside;
    shift.add(root);
    if (ghost) shift.add(rest);
    this.ground.add(shift);
    return Object.assign(machine, { marker, shift });
  }

  addPart(machine, part) {
    const { ghost, bodies, root } = machine, colour = new THREE.Color().setRGB(...part.colour.slice(0, 3), "srgb");
    const material = new THREE.MeshLambertMaterial(ghost || { color: colour, side: THREE.DoubleSide });
    const mesh = new THREE.Mesh(solid(part), material);
    mesh.applyMatrix4(placed(part.pose));
    if (part.kind === "cylinder" || part.kind === "capsule") mesh.rotateX(Math.PI / 2);
    if (!bodies[part.joint]) root.add(bodies[part.joint] = new THREE.Group());
    bodies[part.joint].add(mesh);
    if (part.kind === "box" && !ghost) mesh.add(new THREE.LineSegments(new THREE.EdgesGeometry(mesh.geometry), new THREE.LineBasicMaterial({ color: 0x222222 })));
    if (!ghost) machine.materials.push({ material, colour, mesh });
    return mesh;
  }

  // Payloads, in place of those that were drawn, unless they are the same.
  addPayloads(machine, parts) {
    const wanted = JSON.stringify(parts);
    if (wanted === machine.drawn) return;
    for (const mesh of machine.loads) { mesh.removeFromParent(); release(mesh); }
    machine.materials = machine.materials.filter(({ mesh }) => !machine.loads.includes(mesh));
    machine.loads = parts.map((part) => this.addPart(machine, part));
    machine.drawn = wanted;
  }

  // Centre of mass, and the line from it along gravity to the zero moment point; only where the record has it.
  addMass() {
    const size = this.size || 1;
    this.mass = new THREE.Mesh(new THREE.SphereGeometry(0.013 * size, 20, 14), overlay({ color: 0xffffff }));
    const rim = new THREE.Mesh(new THREE.SphereGeometry(0.017 * size, 20, 14), overlay({ color: 0x000000 }));
    this.plumb = new THREE.Mesh(new THREE.CylinderGeometry(0.003 * size, 0.003 * size, 1, 8), overlay({ color: 0x000000 }));
    rim.renderOrder = 4; this.mass.renderOrder = 5; this.plumb.renderOrder = 4;
    this.mass.add(rim);
    this.plan.root.add(this.mass, this.plumb);
  }

  moveMass(com, point) {
    this.mass.visible = Boolean(com);
    this.plumb.visible = Boolean(com && point);
    if (com) this.mass.position.set(...com);
    if (!com || !point) return;
    const from = new THREE.Vector3(...com), way = new THREE.Vector3(point[0], point[1], this.record.support ? this.record.support.height : 0).sub(from);
    this.plumb.position.copy(from).addScaledVector(way, 0.5);
    this.plumb.scale.set(1, way.length(), 1);
    this.plumb.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), way.normalize());
  }

  // Band on the ground along the zero moment point, coloured by margin.
  addTrail(motion, full) {
    const height = this.record.support ? this.record.support.height : 0, width = 0.005 * this.size, places = [], colours = [];
    const points = motion.zmp.map((point, i) => point && new THREE.Vector3(point[0], point[1], height + 0.001 * this.size).applyMatrix4(placed(poseOf(motion.root, i))));
    for (let i = 0; i + 1 < points.length; i++) {
      const [a, b] = [points[i], points[i + 1]];
      if (!a || !b || a.distanceTo(b) === 0) continue;
      const least = [motion.margin[i], motion.margin[i + 1]];
      const kind = grade(least.includes(null) ? null : Math.min(...least), this.record.margin_asked, full);
      const side = new THREE.Vector3().subVectors(b, a).cross(new THREE.Vector3(0, 0, 1)).setLength(kind === "out" ? 1.6 * width : width);
      const corners = [a.clone().add(side), a.clone().sub(side), b.clone().add(side), b.clone().sub(side)];
      const colour = new THREE.Color(COLOURS[kind]);
      for (const k of [0, 1, 2, 2, 1, 3]) { places.push(...corners[k].toArray()); colours.push(colour.r, colour.g, colour.b); }
    }
    if (this.band) { this.band.removeFromParent(); release(this.band); }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Float32Array(colours), 3));
    this.band = new THREE.Mesh(geometry, overlay({ vertexColors: true, side: THREE.DoubleSide }));
    this.band.renderOrder = 3;
    this.ground.add(this.band);
  }

  // Move a machine to a time; returns its zero moment point and margin.
  move(machine, t) {
    const { motion } = machine, at = locate(motion.times, t), { fall } = motion;
    const arm = fall && fall.over ? locate(motion.times, Math.min(t, fall.times[fall.times.length - 1])) : at;
    if (fall) pose(machine.root, fall.root, locate(fall.times, t)); else pose(machine.root, motion.root, at);
    for (const [joint, group] of Object.entries(machine.bodies)) if (motion.bodies[joint]) pose(group, motion.bodies[joint], arm);
    if (machine !== this.plan && !fall && motion.root.length > 1) pose(machine.marker.parent, motion.root, at);
    const point = pointAt(motion.zmp, at), margin = valueAt(motion.margin, at);
    machine.marker.visible = Boolean(point);
    if (point) machine.marker.position.set(point[0], point[1], this.record.support ? this.record.support.height : 0);
    if (machine === this.plan) this.moveMass(motion.com ? motion.com[0] : null, point);
    const bad = margin === null || margin < 0;
    machine.marker.material.color.set(bad ? COLOURS.out : machine === this.plan ? 0xf0e442 : 0x8899aa);
    return { at, point, margin };
  }

  preset(name) {
    this.looks = name;
    const both = this.blind && this.blind.shift.visible ? this.beside : 0;
    const low = new THREE.Vector3(...this.low), high = new THREE.Vector3(...this.high);
    high.y += both;
    const middle = low.clone().add(high).multiplyScalar(0.5).applyQuaternion(this.ground.quaternion);
    const radius = 0.5 * low.distanceTo(high), away = { corner: [-0.75, -0.85, 0.6], side: [0.02, -1, 0.12], top: [-0.001, 0, 1], rear: [-1, 0, 0.2] }[name];
    const narrow = Math.min(1, this.camera.aspect || 1);
    this.camera.position.copy(middle).add(new THREE.Vector3(...away).setLength(0.72 * radius / Math.sin(this.camera.fov * Math.PI / 360) / narrow));
    this.controls.target.copy(middle);
    this.controls.update();
    this.render();
  }

  show(blind) { if (this.blind) this.blind.shift.visible = blind; this.render(); }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.parent;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.render();
  }

  render() {
    const dark = document.documentElement.classList.contains("dark") && !this.printing;
    this.renderer.setClearColor(dark ? 0x1e242a : 0xe9eef3);
    this.renderer.render(this.scene, this.camera);
  }
}

const COLOURS = { ample: "#0072b2", tight: "#56b4e9", short: "#e69f00", out: "#c1121f" };

function release(mesh) { mesh.traverse((part) => { part.geometry?.dispose(); part.material?.dispose(); }); }

// Material that is seen through the machine.
function overlay(look) { return new THREE.MeshBasicMaterial({ ...look, depthTest: false, transparent: true }); }

// Distance from the origin of a part to its farthest point; computed once.
function reachOf(part) {
  if (part.reach === undefined) {
    let far = Math.hypot(...part.size);
    for (let i = 0; part.vertices && i < part.vertices.length; i += 3) far = Math.max(far, Math.hypot(part.vertices[i], part.vertices[i + 1], part.vertices[i + 2]));
    Object.defineProperty(part, "reach", { value: far }); // not enumerable: saved data stay as they were
  }
  return part.reach;
}

function poseOf(poses, i) { return poses[Math.min(i, poses.length - 1)]; }

function placed(entries) {
  return new THREE.Matrix4().compose(new THREE.Vector3(...entries.slice(0, 3)), new THREE.Quaternion(...entries.slice(3)), new THREE.Vector3(1, 1, 1));
}

function pose(group, poses, at) {
  const [a, b, w] = posesAt(poses, at);
  group.position.set(a[0] + w * (b[0] - a[0]), a[1] + w * (b[1] - a[1]), a[2] + w * (b[2] - a[2]));
  group.quaternion.set(a[3], a[4], a[5], a[6]).slerp(new THREE.Quaternion(b[3], b[4], b[5], b[6]), w);
}

function solid(part) {
  const [a, b, c] = part.size;
  if (part.kind === "box") return new THREE.BoxGeometry(2 * a, 2 * b, 2 * c);
  if (part.kind === "cylinder") return new THREE.CylinderGeometry(a, a, 2 * b, 28);
  if (part.kind === "capsule") return new THREE.CapsuleGeometry(a, 2 * b, 6, 16);
  if (part.kind === "sphere") return new THREE.SphereGeometry(a, 24, 16);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(part.vertices), 3));
  geometry.setIndex(part.faces);
  geometry.computeVertexNormals();
  return geometry;
}

// Edges of the support polygon as flat bands.
function outline(support, colour, width) {
  const shape = new THREE.Group(), material = overlay({ color: colour });
  support.vertices.forEach((from, i) => {
    const to = support.vertices[(i + 1) % support.vertices.length], length = Math.hypot(to[0] - from[0], to[1] - from[1]);
    const bar = new THREE.Mesh(new THREE.BoxGeometry(length + width, width, width), material);
    bar.position.set((from[0] + to[0]) / 2, (from[1] + to[1]) / 2, support.height);
    bar.renderOrder = 2;
    bar.rotation.z = Math.atan2(to[1] - from[1], to[0] - from[0]);
    shape.add(bar);
  });
  return shape;
}

// Triangles of a terrain; the lines of its grid are appended to `grid`.
function terrain(ground, grid) {
  const { heights, resolution, origin } = ground, columns = heights[0].length, places = [], faces = [];
  const at = (row, column) => [origin[0] + column * resolution, origin[1] + row * resolution, heights[row][column]];
  heights.forEach((line, row) => line.forEach((_, column) => {
    places.push(...at(row, column));
    if (column + 1 < columns) grid.push(...at(row, column), ...at(row, column + 1));
    if (row + 1 < heights.length) grid.push(...at(row, column), ...at(row + 1, column));
    if (column + 1 < columns && row + 1 < heights.length) {
      const k = row * columns + column;
      faces.push(k, k + 1, k + columns, k + 1, k + columns + 1, k + columns);
    }
  }));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(places), 3));
  geometry.setIndex(faces);
  geometry.computeVertexNormals();
  return geometry;
}
