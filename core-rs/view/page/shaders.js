// The shaders. Points are looked up by their numbers: their rest positions, and their state at this instant.

import { FOCAL } from "./camera.js";

const HEAD = `#version 300 es
precision highp float;
precision highp sampler2D;
#define FOCAL ${FOCAL.toFixed(3)}
uniform mat4 M;          // metres to picture
uniform vec2 view;       // half the picture [px]
uniform float px;        // what a pixel of a picture of 720 lines is here
uniform float whole;     // [m] the radius of all
uniform float lift;      // least brightness of a point
uniform float net;       // least brightness of a line between points
uniform float smallest;  // [px] least radius of a point
float near(float w){ return clamp(2.3 * whole / w, .7, 5.); }   // what is near is larger
`;

const POINTS = `
uniform sampler2D rest;  // x, y, z [m], style and how far apart the points of its part are [m]
uniform sampler2D state; // displacement and sweep as drawn [m], light, sign
ivec2 place(uint i){ return ivec2(int(i & 1023u), int(i >> 10)); }
vec3 stands(uint i){ vec3 r = texelFetch(rest, place(i), 0).xyz; r.z += texelFetch(state, place(i), 0).x; return r; }
`;

// Brightness carries the same information as hue: speed from dark blue to white, upward motion in bright orange,
// downward in dim blue. A key is visible at rest.
const COLOURS = `
vec3 heat(float e){ return mix(mix(vec3(.10,.20,.55), vec3(.25,.72,1.), smoothstep(0.,.6,e)), vec3(1.,.96,.88), smoothstep(.6,1.,e)); }
vec3 updown(float s){ return s > 0. ? mix(vec3(.40,.44,.50), vec3(1.,.66,.24), s) : mix(vec3(.40,.44,.50), vec3(.16,.26,.85), -s); }
`;

// What is darker than it may be is brightened in its own hue; where a hue has no more light, a grey is added.
const LIFTED = `
float lightness(vec3 c){ return dot(c, vec3(.2126, .7152, .0722)); }
vec3 lifted(vec3 c, float least){
  vec3 bright = min(c * max(1., least / max(lightness(c), 1e-3)), max(c, 1.));
  return bright + max(0., least - lightness(bright));
}
`;

// A shape smaller than a pixel is drawn as one pixel, and darker in proportion to its area.
const LEAST = `
float least(float r, out float dim){ dim = min(1., r * r); return max(r, 1.); }
`;

// A capsule from a to b on the screen, with a radius [px].
const CAPSULE = `
vec4 capsule(vec4 a, vec4 b, vec2 q, float r, out float spread){
  if (a.w <= 0. || b.w <= 0.) { spread = 1.; return vec4(2., 2., 2., 1.); }
  vec2 pa = a.xy / a.w * view, pb = b.xy / b.w * view, d = pb - pa;
  float l = length(d);
  d = l > 1e-3 ? d / l : vec2(0., 1.);
  spread = (l + 2. * r) / (2. * r);
  vec2 p = mix(pa, pb, q.y * .5 + .5) + d * q.y * r + vec2(d.y, -d.x) * q.x * r;
  return vec4(p / view, 0., 1.);
}
`;

const SOFT = `#version 300 es
precision highp float;
in vec2 uv; in vec4 col; out vec4 o;
void main(){ float r = max(0., 1. - dot(uv, uv)); o = vec4(col.rgb * r * r, 1.); }   // round, and dark at its edge`;

export const SHADERS = {
  points: [
    `${HEAD}${POINTS}${COLOURS}${CAPSULE}${LEAST}${LIFTED}
layout(location=0) in vec2 q;
uniform float gain;
out vec2 uv; out vec4 col;
void main(){
  uint i = uint(gl_InstanceID);
  vec4 r = texelFetch(rest, place(i), 0), s = texelFetch(state, place(i), 0);
  uv = q;
  if (s.z < 0.) { gl_Position = vec4(2., 2., 2., 1.); return; }   // hidden
  vec4 a = M * vec4(r.xy, r.z + s.x - s.y, 1.), b = M * vec4(r.xy, r.z + s.x + s.y, 1.);
  float e = clamp(s.z, 0., 1.);
  float style = floor(r.w / 1024.), apart = r.w - 1024. * style;
  float size = px * (style > 1.5 ? 7. : style > .5 ? 1.4 : 1.6 + 1.8 * e) * near(b.w);
  size = min(size, .45 * apart * FOCAL * view.y / b.w);                // a crowd stays points
  float spread, dim;
  float radius = max(least(size, dim), smallest);
  gl_Position = capsule(a, b, q, radius, spread);
  vec3 c = style > .5 ? updown(s.w) * ((style > 1.5 ? .95 : .30) + 1.2 * e) : heat(e) * (.28 + 1.6 * e * e * e);
  // What moves is brighter than what rests.
  col = vec4(lifted(c * mix(1., dim, .75) / pow(spread, .6), lift * (1. + .8 * e)) * gain, 1.);
}`,
    SOFT,
  ],
  links: [
    `${HEAD}${POINTS}${COLOURS}${LIFTED}
layout(location=0) in uvec2 ends;
layout(location=1) in float broken;   // since when [s]
uniform float gain, t;
out vec4 col;
void main(){
  uint i = gl_VertexID == 0 ? ends.x : ends.y;
  vec3 a = stands(ends.x), b = stands(ends.y);
  vec4 s = texelFetch(state, place(i), 0);
  float light = min(texelFetch(state, place(ends.x), 0).z, texelFetch(state, place(ends.y), 0).z);
  gl_Position = light < 0. || t >= broken ? vec4(2., 2., 2., 1.) : M * vec4(gl_VertexID == 0 ? a : b, 1.);
  float strain = abs(b.z - a.z) / max(length(b.xy - a.xy), 1e-6);
  col = vec4(lifted(updown(s.w) * gain * (.10 + .22 * s.z + .45 * clamp(strain, 0., 1.)), net), 1.);
}`,
    `#version 300 es
precision highp float;
in vec4 col; out vec4 o;
void main(){ o = col; }`,
  ],
  // Each spark is above its target, at the height from which it has yet to fall (below, if it pushes up); after the
  // strike it moves back.
  sparks: [
    `${HEAD}${POINTS}${CAPSULE}${LEAST}
layout(location=0) in vec2 q;
layout(location=1) in uint point;
layout(location=2) in vec4 e;   // seconds until it strikes, impulse, radius [px], light
uniform float hold;             // by what radii are multiplied
uniform float fall;             // [m] as drawn for a second of the piece
uniform float reach;            // [s] that they are seen before they strike
out vec2 uv; out vec4 col;
void main(){
  vec3 at = stands(point);
  float d = e.x, side = e.y > 0. ? -1. : 1.;
  vec4 a = M * vec4(at.xy, at.z + side * abs(d) * fall, 1.);
  vec4 b = M * vec4(at.xy, at.z + side * (abs(d) + (d == 0. ? 0. : .012 * reach)) * fall, 1.);
  float spread, dim;
  gl_Position = capsule(a, b, q, least(e.z * hold, dim), spread);
  if (e.w <= 0.) gl_Position = vec4(2., 2., 2., 1.);
  uv = q;
  col = vec4(vec3(1., .80, .25) * e.w * dim, 1.);
}`,
    SOFT,
  ],
  // Contacts and loudspeakers: a disc whose brightness shows the strength.
  discs: [
    `${HEAD}${LEAST}
layout(location=0) in vec2 q;
layout(location=1) in vec4 at;    // x, y, z [m], strength 0 … 1
uniform float size;               // [px of 720 lines]
uniform float far;                // [m] at which it has this size; 0: everywhere
uniform vec3 dark, bright;
out vec2 uv; out vec4 col;
void main(){
  vec4 a = M * vec4(at.xyz, 1.);
  float r = px * size * (.35 + .65 * sqrt(clamp(at.w, 0., 1.))) * (far > 0. ? clamp(far / a.w, .3, 3.) : 1.);
  float dim;
  r = least(r, dim);
  gl_Position = a.w <= 0. ? vec4(2., 2., 2., 1.) : vec4(a.xy / a.w + q * r / view, 0., 1.);
  uv = q;
  col = vec4(mix(dark, bright, clamp(at.w, 0., 1.)) * dim, 1.);
}`,
    `#version 300 es
precision highp float;
in vec2 uv; in vec4 col; out vec4 o;
void main(){ float r = dot(uv, uv); o = vec4(col.rgb * (exp(-4. * r) + .7 * (1. - smoothstep(.22, .30, r))) * step(r, 1.), 1.); }`,
  ],
  lines: [
    `${HEAD}
layout(location=0) in vec3 at;
uniform vec3 dark;
out vec4 col;
void main(){ gl_Position = M * vec4(at, 1.); col = vec4(dark, 1.); }`,
    `#version 300 es
precision highp float;
in vec4 col; out vec4 o;
void main(){ o = col; }`,
  ],
};
