// The terrain's colour (include/relief.glsl is before this), or its distance.
in vec2 v_texel;              // in the level's own surface
in vec2 v_ground;             // height above the ellipsoid, m; blend into the coarser level, 0 to 1
#ifdef RANGE
in vec3 v_position;           // metres from the eye
#endif
#ifdef GRID
uniform vec3 lines_at;        // position in the grid of lines where coordinates in the surface are 0; from 0 to 1 in it
#endif

uniform sampler2D surface;    // normal east and north, crest, kind
uniform sampler2D coarser;    // the same of the coarser level
uniform vec2 coarser_at;      // coordinates in it, less half of those in the level's own

out vec4 o_colour;

#ifdef RANGE
// Distance from the eye in metres as the four bytes of a float, lowest first.
void main() {
    uint bits = floatBitsToUint(length(v_position));
    o_colour = vec4(uvec4(bits, bits >> 8, bits >> 16, bits >> 24) & 255u) / 255.0;
}
#else
void main() {
    // There are no smaller levels of detail, so a fetch needs no derivatives and may stand in a branch.
    vec4 s = textureLod(surface, v_texel, 0.0);
    if (v_ground.y > 0.0) {
        s = mix(s, textureLod(coarser, 0.5 * v_texel + coarser_at, 0.0), v_ground.y);
    }
#ifdef GRID
    vec2 lines = v_texel * lines_at.z + lines_at.xy;
#else
    vec2 lines = vec2(0.0);
#endif
    o_colour = vec4(ground(s, v_ground.x, 1.0 / gl_FragCoord.w, lines), 1.0);
}
#endif
