// Draws the cloth, the colliders and the floor with WebGL.

const CLOTH = `#version 300 es
  in vec3 position, normal;
  uniform mat4 camera;
  out vec3 n, x;
  void main() { n = normal; x = position; gl_Position = camera * vec4(position, 1.0); }`;
// A point of a capsule around the segment from a to b; its sign tells the end it belongs to.
const BODY = `#version 300 es
  in vec3 position, normal;
  uniform mat4 camera;
  uniform vec3 a, b;
  uniform float radius;
  out vec3 n, x;
  void main() {
    n = position;
    x = (position.y > 0.0 ? (a.y > b.y ? a : b) : (a.y > b.y ? b : a)) + radius * position;
    gl_Position = camera * vec4(x, 1.0);
  }`;
const PAINT = `#version 300 es
  precision highp float;
  in vec3 n, x;
  uniform vec3 front, back, eye;
  uniform float checks;
  out vec4 color;
  void main() {
    vec3 normal = normalize(gl_FrontFacing ? n : -n);
    vec3 paint = gl_FrontFacing ? front : back;
    if (checks > 0.0) {
      vec2 cell = floor(x.xz * checks);
      paint *= mod(cell.x + cell.y, 2.0) < 1.0 ? 1.0 : 0.93;
    }
    float sun = max(dot(normal, normalize(vec3(0.5, 0.9, 0.6))), 0.0);
    float sky = 0.5 + 0.5 * normal.y;
    vec3 way = normalize(eye - x);
    float rim = pow(1.0 - max(dot(normal, way), 0.0), 3.0);
    vec3 lit = paint * (0.28 + 0.22 * sky + 0.62 * sun) + 0.06 * rim;
    float far = checks > 0.0 ? smoothstep(1.2, 3.2, length(x.xz)) : 0.0;
    color = vec4(lit, 1.0) * (1.0 - far);
  }`;

const dot = (a, b) => a.reduce((sum, x, k) => sum + x * b[k], 0);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((x) => x / Math.hypot(...a));

export class View {
  constructor(canvas) {
    this.canvas = canvas;
    const gl = (this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true }));
    if (!gl) throw new Error("this browser has no WebGL 2");
    [this.yaw, this.pitch, this.away] = [0.45, 0.12, 3.0];
    this.cloth = this.program(CLOTH);
    this.body = this.program(BODY);
    this.points = gl.createBuffer();
    this.normals = gl.createBuffer();
    this.corners = gl.createBuffer();
    [this.ball, this.ballCount] = this.sphere();
    this.floor = this.filled(gl.ARRAY_BUFFER, new Float32Array([-4, 0, -4, -4, 0, 4, 4, 0, -4, 4, 0, 4]));
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(vertex) {
    const gl = this.gl;
    const program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, PAINT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.bindAttribLocation(program, 0, "position");
    gl.bindAttribLocation(program, 1, "normal");
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    return program;
  }

  filled(target, values, usage = this.gl.STATIC_DRAW, buffer = this.gl.createBuffer()) {
    this.gl.bindBuffer(target, buffer);
    this.gl.bufferData(target, values, usage);
    return buffer;
  }

  // Points of the unit sphere, triangle by triangle, in two halves that are moved apart for a capsule.
  sphere(rows = 24, columns = 40) {
    const points = [];
    const point = (row, column) => {
      // A row on each side of the equator, so that the cylinder in between is drawn.
      const [up, around] = [Math.PI * (row / rows) + (row > rows / 2 ? 1e-3 : -1e-3), (2 * Math.PI * column) / columns];
      points.push(Math.sin(up) * Math.cos(around), Math.cos(up), Math.sin(up) * Math.sin(around));
    };
    for (let row = 0; row < rows; row++)
      for (let column = 0; column < columns; column++)
        for (const [r, c] of [[0, 0], [0, 1], [1, 0], [1, 0], [0, 1], [1, 1]]) point(row + r, column + c);
    return [this.filled(this.gl.ARRAY_BUFFER, new Float32Array(points)), points.length / 3];
  }

  // Sets the cloth to draw and the direction to look from.
  show(toy, yaw) {
    [this.toy, this.yaw] = [toy, yaw];
    const corners = toy.triangles();
    this.count = corners.length;
    this.filled(this.gl.ELEMENT_ARRAY_BUFFER, corners, this.gl.STATIC_DRAW, this.corners);
  }

  turn(yaw, pitch) {
    this.yaw -= yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -0.05), 1.4);
  }

  near(delta) {
    this.away = Math.min(Math.max(this.away * 1.001 ** delta, 1.2), 8);
  }

  // Position of the eye, and its directions right, up and forward.
  eye() {
    const middle = [0, 0.65, 0];
    const back = [Math.sin(this.yaw) * Math.cos(this.pitch), Math.sin(this.pitch), Math.cos(this.yaw) * Math.cos(this.pitch)];
    const right = unit(cross([0, 1, 0], back));
    return { at: middle.map((x, k) => x + this.away * back[k]), right, up: cross(back, right), back };
  }

  // Half the visible height at distance 1, increased for tall pictures so that the width suffices.
  half() {
    const { clientWidth, clientHeight } = this.canvas;
    return 0.36 * Math.max(1, (0.9 * clientHeight) / clientWidth);
  }

  // The ray through a point of the canvas: origin and direction.
  ray(px, py) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const { at, right, up, back } = this.eye();
    const [x, y] = [((2 * px) / width - 1) * this.half() * (width / height), (1 - (2 * py) / height) * this.half()];
    return [at, unit(back.map((b, k) => x * right[k] + y * up[k] - b))];
  }

  camera() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const { at, right, up, back } = this.eye();
    const [near, far] = [0.1, 20];
    const [sx, sy] = [height / (width * this.half()), 1 / this.half()];
    const [sz, tz] = [(near + far) / (near - far), (2 * near * far) / (near - far)];
    const column = (k) => [sx * right[k], sy * up[k], sz * back[k], -back[k]];
    return [...column(0), ...column(1), ...column(2), -sx * dot(right, at), -sy * dot(up, at), -sz * dot(back, at) + tz, dot(back, at)];
  }

  use(program, front, back, checks = 0) {
    const gl = this.gl;
    gl.useProgram(program);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "camera"), false, this.camera());
    gl.uniform3fv(gl.getUniformLocation(program, "eye"), this.eye().at);
    gl.uniform3fv(gl.getUniformLocation(program, "front"), front);
    gl.uniform3fv(gl.getUniformLocation(program, "back"), back);
    gl.uniform1f(gl.getUniformLocation(program, "checks"), checks);
  }

  attribute(index, buffer) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.enableVertexAttribArray(index);
    this.gl.vertexAttribPointer(index, 3, this.gl.FLOAT, false, 0, 0);
  }

  draw() {
    const { gl, canvas } = this;
    const scale = Math.min(devicePixelRatio, 2);
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);

    this.filled(gl.ARRAY_BUFFER, this.toy.positions(), gl.DYNAMIC_DRAW, this.points);
    this.filled(gl.ARRAY_BUFFER, this.toy.normals(), gl.DYNAMIC_DRAW, this.normals);
    this.use(this.cloth, [0.78, 0.3, 0.22], [0.86, 0.74, 0.58]);
    this.attribute(0, this.points);
    this.attribute(1, this.normals);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.corners);
    gl.drawElements(gl.TRIANGLES, this.count, gl.UNSIGNED_INT, 0);

    this.use(this.body, [0.42, 0.5, 0.6], [0.42, 0.5, 0.6]);
    this.attribute(0, this.ball);
    gl.disableVertexAttribArray(1);
    const bodies = this.toy.bodies();
    for (let k = 0; k < bodies.length; k += 7) {
      gl.uniform3fv(gl.getUniformLocation(this.body, "a"), bodies.slice(k, k + 3));
      gl.uniform3fv(gl.getUniformLocation(this.body, "b"), bodies.slice(k + 3, k + 6));
      gl.uniform1f(gl.getUniformLocation(this.body, "radius"), bodies[k + 6] - 0.004);
      gl.drawArrays(gl.TRIANGLES, 0, this.ballCount);
    }

    gl.enable(gl.BLEND);
    this.use(this.cloth, [0.6, 0.62, 0.66], [0.6, 0.62, 0.66], 4);
    this.attribute(0, this.floor);
    gl.vertexAttrib3f(1, 0, 1, 0);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.disable(gl.BLEND);
  }
}
