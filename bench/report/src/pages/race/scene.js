"use strict";
// The arms in 3D: one canvas behind all lanes, with a part of it for each. Lengths in mm, z up.

class Arm {
  constructor(chain, materials) {
    this.chain = chain;
    this.root = new THREE.Group();
    const add = (group, body, material) => group.add(Arm.rod(body, material));
    chain.base.forEach(body => add(this.root, body, materials.dark));
    let parent = this.root;
    this.joints = chain.joints.map((joint, index) => {
      const group = new THREE.Group();
      joint.bodies.forEach(body => add(group, body, index % 2 ? materials.dark : materials.light));
      parent.add(group);
      parent = group;
      return group;
    });
    const placed = frame => {
      const group = new THREE.Group();
      group.position.set(...frame.at_mm);
      const [w, x, y, z] = frame.quaternion;
      group.quaternion.set(x, y, z, w);
      parent.add(group);
      parent = group;
      return group;
    };
    placed(chain.flange);
    const flange = parent;
    this.tip = placed(chain.tool);
    const radius = chain.radius_mm;
    if (Math.hypot(...chain.tool.at_mm) > radius * 0.2) {
      add(flange, { from: [0, 0, 0], to: chain.tool.at_mm, radius: radius * 0.2 }, materials.own);
    }
    const ball = new THREE.Mesh(new THREE.SphereGeometry(radius * 0.5, 20, 14), materials.own);
    this.tip.add(ball);
  }

  static rod({ from, to, radius }, material) {
    const [start, end] = [new THREE.Vector3(...from), new THREE.Vector3(...to)];
    const along = end.clone().sub(start);
    const mesh = new THREE.Mesh(new THREE.CapsuleGeometry(radius, along.length(), 6, 20), material);
    mesh.position.copy(start).addScaledVector(along, 0.5);
    if (along.length() > 0) mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
    return mesh;
  }

  move(values) {
    this.chain.joints.forEach((joint, index) => {
      const [group, by] = [this.joints[index], values[index] * joint.sign - joint.zero];
      const axis = new THREE.Vector3(...joint.axis);
      group.position.set(...joint.offset_mm);
      if (joint.is_linear) group.position.addScaledVector(axis, by);
      else group.quaternion.setFromAxisAngle(axis, by * Math.PI / 180);
    });
    this.root.updateMatrixWorld(true);
  }

  tool() { return this.tip.getWorldPosition(new THREE.Vector3()); }

  // The ends of the bodies and the tool, for the view to contain them.
  extent() {
    const points = this.chain.joints.flatMap(({ bodies }, index) => bodies.flatMap(({ from, to }) =>
      [from, to].map(end => new THREE.Vector3(...end).applyMatrix4(this.joints[index].matrixWorld))));
    return [...points, this.tool()];
  }
}

// The arms of the cell, each with where it stands; the only arm of other setups stands at the origin.
const places = run.arms ?? [{ arm: run.arm, cell: run.cell }];

// Puts a group where a frame is.
const put = (group, { at_mm: at, quaternion: [w, x, y, z] }) => {
  group.position.set(...at);
  group.quaternion.set(x, y, z, w);
};

// One arm in a world: obstacles, targets, the arm and its way.
class Actor {
  static SEGMENTS = 900;

  constructor(recording, place, world) {
    this.recording = recording;
    this.place = place;
    this.world = world;
    this.root = new THREE.Group();
    if (place.root) put(this.root, place.root);
    world.scene.add(this.root);
    this.root.updateMatrixWorld(true);
    this.arm = new Arm(place.arm, world.materials);
    this.root.add(this.arm.root);
    const placed = point => new THREE.Vector3(...point).applyMatrix4(this.root.matrixWorld);
    this.targets = place.cell.targets.map(placed);
    this.points = place.arm.base.flatMap(({ from, to }) => [from, to].map(placed));
    this.surroundings();
    this.fixed = this.points;
    this.ball = new THREE.SphereGeometry(place.arm.radius_mm * 0.34, 14, 10);
    this.way();
  }

  surroundings() {
    const { cell, arm } = this.place;
    const base = new THREE.Group();
    put(base, cell.base);
    this.root.add(base);
    for (const { lower_mm: lower, upper_mm: upper } of cell.obstacles) {
      const size = upper.map((high, axis) => high - lower[axis]);
      const box = new THREE.Mesh(new THREE.BoxGeometry(...size), this.world.solid);
      box.position.set(...upper.map((high, axis) => (high + lower[axis]) / 2));
      const edges = new THREE.LineSegments(new THREE.EdgesGeometry(box.geometry), this.world.line);
      box.add(edges);
      base.add(box);
      this.root.updateMatrixWorld(true);
      for (let corner = 0; corner < 8; corner += 1) {
        const at = new THREE.Vector3(...upper.map((high, axis) => (corner >> axis & 1 ? high : lower[axis])));
        this.points.push(at.applyMatrix4(base.matrixWorld));
      }
    }
    const dot = new THREE.SphereGeometry(arm.radius_mm * 0.16, 10, 8);
    for (const target of this.targets) {
      const mesh = new THREE.Mesh(dot, this.world.materials.dark);
      mesh.position.copy(target);
      this.world.scene.add(mesh);
    }
  }

  // The way of the tool as a tube that grows, and a ball where the arm stood still.
  way() {
    const { recording, arm, place, world } = this;
    const radius = place.arm.radius_mm;
    const points = [];
    this.forget();
    this.points = [...this.fixed];
    const every = Math.ceil(recording.times.length / 80);
    this.lengths = new Float64Array(recording.times.length);
    let length = 0;
    recording.times.forEach((moment, index) => {
      arm.move(recording.joints(moment));
      const at = arm.tool();
      if (index % every === 0) this.points.push(...arm.extent());
      if (points.length) length += at.distanceTo(points.at(-1));
      this.lengths[index] = length;
      if (!points.length || at.distanceTo(points.at(-1)) > radius * 0.02) points.push(at);
      else if (points.length) this.lengths[index] = length -= at.distanceTo(points.at(-1));
    });
    this.length = length;
    if (points.length > 1) {
      const curve = new THREE.CatmullRomCurve3(points, false, "catmullrom", 0);
      curve.arcLengthDivisions = Math.max(200, points.length);
      const tube = new THREE.TubeGeometry(curve, Actor.SEGMENTS, radius * 0.13, 6);
      this.tube = new THREE.Mesh(tube, world.materials.own);
      this.ghost = new THREE.Mesh(
        new THREE.TubeGeometry(curve, Actor.SEGMENTS, radius * 0.04, 5), world.materials.dark);
      world.scene.add(this.tube, this.ghost);
    }
    this.balls = recording.stills.map(([from]) => {
      arm.move(recording.joints(from));
      const mesh = new THREE.Mesh(this.ball, world.materials.still);
      mesh.position.copy(arm.tool());
      world.scene.add(mesh);
      return mesh;
    });
  }

  // Removes the way that was drawn before.
  forget() {
    this.world.scene.remove(...[this.tube, this.ghost, ...this.balls ?? []].filter(Boolean));
    [this.tube, this.ghost].forEach(mesh => mesh?.geometry.dispose());
    [this.tube, this.ghost, this.balls] = [null, null, []];
  }

  show(moment) {
    const { recording, arm } = this;
    arm.move(recording.joints(moment));
    if (this.tube) {
      const index = Math.max(0, lastBefore(recording.times.length, i => recording.times[i], moment));
      const segments = Math.round(this.lengths[index] / this.length * Actor.SEGMENTS);
      this.tube.geometry.setDrawRange(0, segments * 6 * 6);
    }
    const { count } = recording.still(moment);
    this.balls.forEach((ball, index) => { ball.visible = index < count; });
    return arm.tool();
  }
}

// One lane's world: its arms, and what stands around them.
class World {
  constructor(recording) {
    this.recording = recording;
    this.scene = new THREE.Scene();
    const lambert = () => new THREE.MeshLambertMaterial();
    this.materials = { light: lambert(), dark: lambert(), own: lambert(), still: lambert() };
    this.line = new THREE.LineBasicMaterial({ transparent: true, opacity: 0.75 });
    this.solid = new THREE.MeshLambertMaterial({ transparent: true, opacity: 0.22, depthWrite: false });
    this.sky = new THREE.HemisphereLight(0xffffff, 0x999999, 2.2);
    this.sun = new THREE.DirectionalLight(0xffffff, 1.6);
    this.sun.position.set(0.6, -0.5, 1);
    this.scene.add(this.sky, this.sun);
    this.actors = (recording.arms ?? [recording]).map((own, index) => new Actor(own, places[index], this));
    this.gather();
  }

  gather() { this.points = this.actors.flatMap(actor => actor.points); }

  way() {
    this.actors.forEach(actor => actor.way());
    this.gather();
  }

  colours() {
    this.materials.light.color.set(colourOf("body"));
    this.materials.dark.color.set(colourOf("joint"));
    this.materials.own.color.set(colourOf(this.recording.key));
    this.materials.still.color.set(colourOf("ink"));
    this.solid.color.set(colourOf("axis"));
    this.line.color.set(colourOf("axis"));
  }

  // Moves the arms and returns where their tools are.
  show(moment) { return this.actors.map(actor => actor.show(moment)); }
}

// The renderer, one camera for all lanes, and its directions.
class Stage {
  constructor(canvas, views, worlds) {
    this.views = views;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.renderer.setScissorTest(true);
    this.worlds = worlds;
    this.camera = new THREE.PerspectiveCamera(24, 1, 10, 50000);
    this.camera.up.set(0, 0, 1);
    this.contain();
    const work = new THREE.Vector3();
    // One arm is seen from its targets; several, which face each other, across.
    const targets = worlds.length && places.length === 1 ? worlds[0].actors[0].targets : [];
    const points = targets.length ? targets : [this.middle];
    points.forEach(point => work.add(point));
    this.front = Math.atan2(work.y, work.x);
    this.turn = 0;
    this.tilt = 0;
    this.look("corner");
    this.colours();
  }

  // Whether there is WebGL 2; without it three.js would write errors to the console.
  static isPossible() {
    try {
      return Boolean(document.createElement("canvas").getContext("webgl2"));
    } catch {
      return false;
    }
  }

  look(view) {
    const degrees = { corner: [58, 22], side: [90, 4], front: [0, 4], above: [0, 89] }[view];
    [this.turn, this.tilt] = degrees.map(value => value * Math.PI / 180);
  }

  drag(right, down) {
    this.turn -= right * 0.008;
    this.tilt = Math.min(1.55, Math.max(-0.2, this.tilt + down * 0.008));
  }

  colours() { this.worlds.forEach(world => world.colours()); }

  // Takes what the worlds reach as what the camera has to show.
  contain() {
    this.points = this.worlds.flatMap(world => world.points);
    this.middle = new THREE.Box3().setFromPoints(this.points).getCenter(new THREE.Vector3());
    this.seen = null;
  }

  // Puts the camera where all that the arms reach just fits into a view of this shape.
  place(aspect) {
    const seen = [aspect, this.turn, this.tilt].join();
    if (seen === this.seen) return;
    this.seen = seen;
    const { camera } = this;
    const angle = this.front + this.turn;
    const out = new THREE.Vector3(
      Math.cos(angle) * Math.cos(this.tilt), Math.sin(angle) * Math.cos(this.tilt), Math.sin(this.tilt));
    camera.aspect = aspect;
    camera.position.copy(this.middle).add(out);
    camera.lookAt(this.middle);
    camera.updateMatrixWorld(true);
    const [right, up] = [new THREE.Vector3(), new THREE.Vector3()];
    camera.matrixWorld.extractBasis(right, up, new THREE.Vector3());
    const flat = new THREE.Box3().setFromPoints(this.points.map(point => new THREE.Vector3(point.dot(right), point.dot(up), point.dot(out))));
    const middle = flat.getCenter(new THREE.Vector3());
    const tangent = Math.tan(camera.fov * Math.PI / 360);
    const thick = Math.max(...places.map(({ arm }) => arm.radius_mm)) * 1.3;
    const far = this.points.reduce((most, point) => {
      const [x, y] = [Math.abs(point.dot(right) - middle.x) + thick, Math.abs(point.dot(up) - middle.y) + thick];
      return Math.max(most, Math.max(x / aspect, y) / tangent + point.dot(out));
    }, 0);
    camera.position.set(0, 0, 0).addScaledVector(right, middle.x).addScaledVector(up, middle.y).addScaledVector(out, far);
    camera.updateMatrixWorld(true);
    camera.updateProjectionMatrix();
  }

  // Draws all lanes and returns where the tools are, of each lane.
  show(moment) {
    const canvas = this.renderer.domElement;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    const ratio = Math.min(devicePixelRatio || 1, 2);
    if (this.width !== width || this.height !== height || this.ratio !== ratio) {
      [this.width, this.height, this.ratio] = [width, height, ratio];
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
    }
    const whole = canvas.getBoundingClientRect();
    return this.worlds.map((world, index) => {
      const part = this.views[index].getBoundingClientRect();
      const rectangle = [part.left - whole.left, whole.bottom - part.bottom, part.width, part.height];
      this.renderer.setViewport(...rectangle);
      this.renderer.setScissor(...rectangle);
      this.place(part.width / Math.max(1, part.height));
      const tools = world.show(moment);
      this.renderer.render(world.scene, this.camera);
      return tools;
    });
  }
}
