// The Earth in one piece, as seen from 20 km and more: a ray against the WGS 84 ellipsoid for each pixel
// (include/relief.glsl is before this).
// Space: Earth-centred axes turned about the Earth's axis so that the eye is over the meridian of x, and stretched so that
// the ellipsoid is the unit sphere. Whatever cancels (1 against the eye's distance) was computed in 64 bits.
uniform vec4 eye;             // where it is; its distance from the centre, squared, less 1
uniform vec3 view_x;          // the direction through a pixel is view_x x + view_y y + view_z, x and y from -1 to 1
uniform vec3 view_y;
uniform vec3 view_z;
uniform vec4 extent;          // tangents of half the field of view; 2 / pixels across and up
uniform vec4 picture;         // texel of the eye's meridian and of the equator; texels per radian; texels around the Earth
uniform vec3 texels;          // 1 / columns, 1 / rows of the picture; pixels per radian
uniform vec2 opacity;         // of the Earth, of the sky
uniform float relief;         // how far the ground stands out from the ellipsoid: 1 low down, 0 from afar
#ifdef GRID
uniform vec4 lines_at;        // the eye's meridian among the lines; lines per radian
#endif
uniform sampler2D surface;    // normal east and north, crest, kind
uniform sampler2D heights;    // for the tint

out vec4 o_colour;

const float EARTH_M = 6378137.0;
const float AIR_M = 16800.0;  // gl::sky::AIR_M
const float HAZE_M = 25000.0; // the hazy air, seen from above

// Longitude from the eye's meridian and geodetic latitude, radians.
vec2 place_of(vec3 n) {
    return vec2(atan(n.y, n.x), atan(n.z * 1.003364090, length(n.xy)));
}

vec2 uv_of(vec2 place) {
    vec2 at = place * picture.z + picture.xy;
    at.x -= picture.w * floor((at.x + 0.5) / picture.w);
    return (at + 0.5) * texels.xy;
}

bool is_outside(vec2 uv) {
    vec2 away = abs(uv - 0.5);
    return max(away.x, away.y) > 0.5;
}

// See terrain::globe::encode_tint.
float height_at(vec2 uv, float detail) {
    return is_outside(uv) ? 0.0 : textureLod(heights, uv, detail).x * 6375.0 - 500.0;
}

void main() {
    vec2 p = gl_FragCoord.xy * extent.zw - 1.0;
    vec3 ray = view_z + view_x * p.x + view_y * p.y;
    float a = dot(ray, ray);
    float b = dot(ray, eye.xyz);
    // The square of half the chord, times a: negative outside the limb.
    float chord = b * b - a * eye.w;
    // Coverage of the pixel by its signed distance from the limb.
    float limb = chord / max(length(vec2(dFdx(chord), dFdy(chord))), 1e-30);
    float covered = b < 0.0 ? clamp(limb + 0.5, 0.0, 1.0) : 0.0;

    // Air: by how near the ray comes to the ground.
    float above = b < 0.0 ? max(-chord / a, 0.0) : eye.w;
    float height = EARTH_M * above / (1.0 + sqrt(1.0 + above));
    vec3 sky = vec3(0.50, 0.72, 0.93) * exp2(-height * (1.442695 / AIR_M)) * brightness;

    float root = sqrt(max(chord, 0.0));
    float facing = max(root * inversesqrt(a), 1e-3);
    float far = eye.w / max(root - b, 1e-9);
    vec3 n = eye.xyz + far * ray;
    // Level of detail from the size of a pixel on the ground; no derivatives, so no seam where longitudes wrap.
    float distance = EARTH_M * far * length(vec3(p * extent.xy, 1.0));
    float size = distance * picture.z / (EARTH_M * texels.z);
    float detail = log2(size * inversesqrt(facing * max(length(n.xy), 0.05)));
    vec2 place = place_of(n);
    vec2 uv = uv_of(place);
    float rise = height_at(uv, detail);
    if (relief > 0.0) {
        // Low down mountains hide what is behind them: where the ray meets the ground, to a few tens of metres, unless it
        // grazes.
        float trust = relief * clamp(10.0 * facing - 0.5, 0.0, 1.0);
        for (int i = 0; i < 3; i++) {
            float r = trust * rise / EARTH_M;
            float c = eye.w - r * (2.0 + r);
            far = c / max(sqrt(max(b * b - a * c, 0.0)) - b, 1e-9);
            place = place_of(eye.xyz + far * ray);
            uv = uv_of(place);
            rise = height_at(uv, detail);
        }
    }
    vec4 s = textureLod(surface, uv, detail);
    s.w = is_outside(uv) ? 1.0 : s.w;
#ifdef GRID
    vec2 lines = place * lines_at.y + vec2(lines_at.x, 0.0);
#else
    vec2 lines = vec2(0.0);
#endif
    vec3 colour = ground(s, rise, min(distance, HAZE_M / facing), lines);
    o_colour = vec4(mix(sky, colour, covered), mix(opacity.y, opacity.x, covered));
}
