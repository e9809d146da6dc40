// The terrain's colour: a tint by height, shaded by slope and by crests and hollows; water; missing data; haze.
in vec4 v_texel;
in vec2 v_ground;
#ifdef RANGE
in vec3 v_position;
#endif

uniform sampler2D surface;    // normal east and north, crest, kind
uniform sampler2D coarser;    // the same of the coarser level
uniform vec3 key;             // towards the lights, unit vectors east, north, up
uniform vec3 fill;
uniform vec4 haze;            // colour; 1 / distance at which 63 % of it is reached, 1/m

out vec4 o_colour;

#ifdef RANGE
void main() {
    uint bits = floatBitsToUint(length(v_position));
    o_colour = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
#else
vec3 tint(float height) {
    vec3 c = vec3(0.27, 0.43, 0.22);
    c += vec3(0.16, 0.08, 0.04) * clamp(height * (1.0 / 900.0), 0.0, 1.0);
    c += vec3(0.20, 0.05, 0.10) * clamp((height - 900.0) * (1.0 / 1100.0), 0.0, 1.0);
    c += vec3(-0.04, -0.10, -0.03) * clamp((height - 2000.0) * (1.0 / 900.0), 0.0, 1.0);
    c += vec3(0.05, 0.10, 0.18) * clamp((height - 2900.0) * (1.0 / 1000.0), 0.0, 1.0);
    return c + vec3(0.31, 0.39, 0.44) * clamp((height - 3900.0) * (1.0 / 1400.0), 0.0, 1.0);
}

void main() {
    vec4 s = textureLod(surface, v_texel.xy, 0.0);
    if (v_ground.y > 0.0) {
        s = mix(s, textureLod(coarser, v_texel.zw, 0.0), v_ground.y);
    }
    vec3 code = s.xyz * (255.0 / 127.0) - (128.0 / 127.0);
    vec2 slope = code.xy * (0.5 + 0.5 * abs(code.xy));
    float up = sqrt(max(1.0 - dot(slope, slope), 0.0));
    float steep = clamp((0.92 - up) * 3.0, 0.0, 1.0);
    vec3 land = mix(tint(v_ground.x), vec3(0.42, 0.40, 0.39), 0.6 * steep);
    vec3 drawn = normalize(vec3((2.6 - 1.2 * steep) * slope, up));
    float light = 0.26 + 1.02 * max(dot(drawn, key), 0.0) + 0.30 * max(dot(drawn, fill), 0.0);
    land *= light * (1.0 + 0.6 * code.z);
    vec3 water = vec3(0.10, 0.34, 0.62);
    vec3 colour = mix(land, water, clamp(4.0 - 12.0 * s.w, 0.0, 1.0));
    float stripe = step(0.5, fract((gl_FragCoord.x + gl_FragCoord.y) * (1.0 / 12.0)));
    vec3 missing = mix(vec3(0.10, 0.05, 0.12), vec3(0.42, 0.16, 0.50), stripe);
    colour = s.w > 0.75 ? missing : colour;
    float distance = 1.0 / gl_FragCoord.w;
    float veil = 0.78 * (1.0 - exp2(-distance * haze.w * 1.4427));
    o_colour = vec4(mix(colour, haze.rgb, veil), 1.0);
}
#endif
