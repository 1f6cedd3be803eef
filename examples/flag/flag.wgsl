// The sky, a pole and a flag. Colors are linear; the target encodes them.

struct View {
    // From the world to the picture.
    matrix: mat4x4f,
    eye: vec3f,
    // What the flag's positions are less.
    origin: vec3f,
    // Toward the sun.
    sun: vec3f,
}

@group(0) @binding(0) var<uniform> view: View;

const SUN = vec3f(1.38, 1.27, 1.10);
const SKY = vec3f(0.42, 0.58, 0.84);
const GROUND = vec3f(0.28, 0.25, 0.20);

struct Seen {
    @builtin(position) clip: vec4f,
    @location(0) at: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
}

fn seen(at: vec3f, normal: vec3f, uv: vec2f) -> Seen {
    return Seen(view.matrix * vec4f(at, 1.0), at, normal, uv);
}

// The cloth's own buffers, as they are.
@vertex
fn cloth(@location(0) position: vec3f, @location(1) normal: vec3f, @location(2) uv: vec2f) -> Seen {
    return seen(position + view.origin, normal, uv);
}

@vertex
fn solid(@location(0) position: vec3f, @location(1) normal: vec3f) -> Seen {
    return seen(position, normal, vec2f());
}

fn ambient(normal: vec3f) -> vec3f {
    return 0.62 * mix(GROUND, SKY, 0.5 + 0.5 * normal.y);
}

// 1 inside of the curve where `distance` is 0, smooth over a pixel.
fn inside(distance: f32) -> f32 {
    return clamp(0.5 - distance / fwidth(distance), 0.0, 1.0);
}

// A disc on two fields. `uv` in heights of the flag, from the top of its pole's side.
fn pattern(uv: vec2f) -> vec3f {
    let fields = mix(vec3f(0.012, 0.105, 0.16), vec3f(0.60, 0.065, 0.035), inside(uv.x - 1.5 * uv.y));
    return mix(fields, vec3f(0.86, 0.78, 0.60), inside(distance(uv, vec2f(0.75, 0.5)) - 0.27));
}

@fragment
fn cloth_shade(in: Seen, @builtin(front_facing) front: bool) -> @location(0) vec4f {
    let normal = normalize(select(-in.normal, in.normal, front));
    let albedo = pattern(in.uv);
    let border = min(min(in.uv.x, 1.5 - in.uv.x), min(in.uv.y, 1.0 - in.uv.y));
    // The hem is sewn double: less light comes through.
    let thin = 1.0 - 0.55 * inside(border - 0.018);
    let facing = dot(normal, view.sun);
    // Some of the light on the far side comes through, in the cloth's color twice over.
    let through = 0.55 * thin * max(-facing, 0.0) * sqrt(albedo);
    let to_eye = normalize(view.eye - in.at);
    let sheen = 0.10 * pow(1.0 - clamp(dot(normal, to_eye), 0.0, 1.0), 3.0) * SKY;
    let seam = 1.0 - 0.35 * inside(abs(border - 0.018) - 0.0012);
    return vec4f(seam * albedo * (SUN * (max(facing, 0.0) + through) + ambient(normal)) + sheen, 1.0);
}

@fragment
fn solid_shade(in: Seen) -> @location(0) vec4f {
    let normal = normalize(in.normal);
    let to_eye = normalize(view.eye - in.at);
    let gloss = pow(max(dot(normal, normalize(to_eye + view.sun)), 0.0), 60.0);
    return vec4f(vec3f(0.55, 0.54, 0.52) * (SUN * max(dot(normal, view.sun), 0.0) + ambient(normal)) + 0.6 * gloss * SUN, 1.0);
}

struct Far {
    @builtin(position) clip: vec4f,
    @location(0) across: vec2f,
}

// One triangle over the whole picture, behind everything.
@vertex
fn sky(@builtin(vertex_index) index: u32) -> Far {
    let across = vec2f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0);
    return Far(vec4f(across, 1.0, 1.0), across);
}

@fragment
fn sky_shade(in: Far) -> @location(0) vec4f {
    let height = 0.5 + 0.5 * in.across.y;
    let haze = mix(vec3f(0.80, 0.85, 0.90), vec3f(0.13, 0.30, 0.62), pow(height, 0.8));
    let glow = exp(-1.6 * length(in.across - vec2f(-0.9, 1.1)));
    return vec4f(mix(haze, vec3f(1.0, 0.94, 0.82), 0.55 * glow), 1.0);
}
