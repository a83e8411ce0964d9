// A small layer over WebGL2: programs with their uniforms, buffers, textures of numbers.

export const WIDTH = 1024; // of a texture that holds points

/** A WebGL2 context; null if there is none. */
export function context(canvas) {
  return canvas.getContext("webgl2", {
    alpha: false,
    antialias: false,
    preserveDrawingBuffer: true, // so that a frame can be read after it was drawn
    powerPreference: "high-performance",
  });
}

export class Program {
  constructor(gl, [vertex, fragment]) {
    this.gl = gl;
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    if (!gl.getProgramParameter(this.program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(this.program));
    this.places = new Map();
    const n = gl.getProgramParameter(this.program, gl.ACTIVE_UNIFORMS);
    for (let i = 0; i < n; i++) {
      const { name } = gl.getActiveUniform(this.program, i);
      this.places.set(name, gl.getUniformLocation(this.program, name));
    }
  }

  /** Makes the program current, and sets its uniforms: a number, 2, 3 or 16 numbers, or a texture unit as {unit}. */
  use(values) {
    const { gl } = this;
    gl.useProgram(this.program);
    for (const [name, value] of Object.entries(values)) {
      const at = this.places.get(name);
      if (at === undefined) continue;
      if (typeof value === "number") gl.uniform1f(at, value);
      else if (value.unit !== undefined) gl.uniform1i(at, value.unit);
      else if (value.length === 16) gl.uniformMatrix4fv(at, false, value);
      else gl[`uniform${value.length}fv`](at, value);
    }
  }
}

/** A buffer that grows as needed. */
export class Buffer {
  constructor(gl, data = null) {
    this.gl = gl;
    this.buffer = gl.createBuffer();
    this.room = 0;
    if (data) this.put(data);
  }

  put(data) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    if (data.byteLength > this.room) {
      this.room = data.byteLength;
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.DYNAMIC_DRAW);
    } else gl.bufferSubData(gl.ARRAY_BUFFER, 0, data);
  }

  /** Binds the buffer as an attribute of `n` numbers, for each vertex or (each: 1) for each instance. */
  attribute(at, n, { each = 0, stride = 0, offset = 0, integers = false } = {}) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffer);
    gl.enableVertexAttribArray(at);
    if (integers) gl.vertexAttribIPointer(at, n, gl.UNSIGNED_INT, stride, offset);
    else gl.vertexAttribPointer(at, n, gl.FLOAT, false, stride, offset);
    gl.vertexAttribDivisor(at, each);
  }
}

/** Four numbers for each point. */
export class PointTexture {
  constructor(gl, unit, n) {
    this.gl = gl;
    this.unit = unit;
    this.rows = Math.max(1, Math.ceil(n / WIDTH));
    this.data = new Float32Array(4 * WIDTH * this.rows);
    this.texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    for (const name of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl[name], gl.NEAREST);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, WIDTH, this.rows);
  }

  put() {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + this.unit);
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, WIDTH, this.rows, gl.RGBA, gl.FLOAT, this.data);
  }

  delete() {
    this.gl.deleteTexture(this.texture);
  }
}
