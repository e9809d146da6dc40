// The terrain's colour: a tint by height, shaded by the slope; water; places without data; haze by distance.
// Colours follow AC 25-11B table 5-1 (earth tan and brown); water is blue and missing data violet on black, and neither
// colour occurs on land.
in vec4 v_texel;
in vec2 v_ground;
#ifdef RANGE
in vec3 v_position;
#endif

uniform sampler2D surface;    // normal east and north, water, void
uniform sampler2D coarser;    // the same of the coarser level
uniform vec4 haze;            // colour; 1 / distance at which 63 % of it is reached, 1/m

out vec4 o_colour;

#ifdef RANGE
// Distance from the eye in metres as the four bytes of a float, lowest first.
void main() {
    uint bits = floatBitsToUint(length(v_position));
    o_colour = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
#else
// Towards the light: from the north-west, 40 degrees high; and a weaker one from the south-west, so that slopes along
// the first are still told apart.
const vec3 KEY = vec3(-0.5417, 0.5417, 0.6428);
const vec3 FILL = vec3(-0.6124, -0.6124, 0.5);

vec3 tint(float height) {
    vec3 c = mix(vec3(0.34, 0.46, 0.25), vec3(0.50, 0.53, 0.29), smoothstep(0.0, 600.0, height));
    c = mix(c, vec3(0.68, 0.57, 0.36), smoothstep(400.0, 1400.0, height));
    c = mix(c, vec3(0.58, 0.45, 0.31), smoothstep(1400.0, 2600.0, height));
    c = mix(c, vec3(0.60, 0.55, 0.50), smoothstep(2600.0, 3800.0, height));
    return mix(c, vec3(0.94, 0.95, 0.97), smoothstep(3800.0, 5400.0, height));
}

void main() {
    vec4 s = mix(texture(surface, v_texel.xy), texture(coarser, v_texel.zw), v_ground.y);
    // Byte 128 is exactly 0, see terrain::surface::encode_normal.
    vec2 slope = s.xy * (255.0 / 127.0) - (128.0 / 127.0);
    vec3 normal = vec3(slope, sqrt(max(1.0 - dot(slope, slope), 0.0)));
    float key = max(dot(normal, KEY), 0.0);
    float fill = max(dot(normal, FILL), 0.0);
    // 1 on level ground.
    float light = 0.30 + 0.87 * key + 0.28 * fill;
    vec3 land = tint(v_ground.x) * light;
    vec3 water = vec3(0.10, 0.34, 0.62);
    vec3 colour = mix(land, water, smoothstep(0.4, 0.6, s.z));
    // Hatching that stands still on the screen: no terrain moves like that.
    float stripe = step(0.5, fract((gl_FragCoord.x + gl_FragCoord.y) * (1.0 / 12.0)));
    vec3 missing = mix(vec3(0.10, 0.05, 0.12), vec3(0.42, 0.16, 0.50), stripe);
    colour = mix(colour, missing, step(0.5, s.w));
    float distance = 1.0 / gl_FragCoord.w;
    float veil = 0.78 * (1.0 - exp(-distance * haze.w));
    o_colour = vec4(mix(colour, haze.rgb, veil), 1.0);
}
#endif
