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
uniform vec3 key;             // towards the lights, unit vectors east, north, up
uniform vec3 fill;
uniform vec4 haze;            // colour; 1 / distance at which 63 % of it is reached, 1/m

out vec4 o_colour;

#ifdef RANGE
// Distance from the eye in metres as the four bytes of a float, lowest first.
void main() {
    uint bits = floatBitsToUint(length(v_position));
    o_colour = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
#else
// Bottom of a valley to summit.
vec3 tint(float height) {
    vec3 c = mix(vec3(0.34, 0.47, 0.28), vec3(0.47, 0.53, 0.31), smoothstep(0.0, 600.0, height));
    c = mix(c, vec3(0.63, 0.58, 0.39), smoothstep(500.0, 1500.0, height));
    c = mix(c, vec3(0.60, 0.49, 0.36), smoothstep(1500.0, 2500.0, height));
    c = mix(c, vec3(0.66, 0.61, 0.56), smoothstep(2500.0, 3700.0, height));
    return mix(c, vec3(0.96, 0.96, 0.97), smoothstep(3700.0, 5200.0, height));
}

void main() {
    // There are no smaller levels of detail, so a fetch needs no derivatives and may stand in a branch.
    vec4 s = textureLod(surface, v_texel.xy, 0.0);
    if (v_ground.y > 0.0) {
        s = mix(s, textureLod(coarser, v_texel.zw, 0.0), v_ground.y);
    }
    // Byte 128 is exactly 0, see terrain::surface::encode_normal.
    vec2 slope = s.xy * (255.0 / 127.0) - (128.0 / 127.0);
    vec3 normal = vec3(slope, sqrt(max(1.0 - dot(slope, slope), 0.0)));
    // Steep ground shows its rock; gentle relief is drawn steeper than it is, so that a plain is not a blank.
    float steep = smoothstep(0.10, 0.45, 1.0 - normal.z);
    vec3 land = mix(tint(v_ground.x), vec3(0.50, 0.45, 0.40), 0.5 * steep);
    vec3 drawn = normalize(vec3((2.6 - 1.2 * steep) * normal.xy, normal.z));
    // 1 on level ground.
    land *= 0.35 + 0.83 * max(dot(drawn, key), 0.0) + 0.28 * max(dot(drawn, fill), 0.0);
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
