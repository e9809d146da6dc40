// Coverage from signed distances in pixels. Out: premultiplied colour, blended with (ONE, ONE_MINUS_SRC_ALPHA).

uniform mediump sampler2D u_atlas; // R8, signed distance to the outline, 0.5 on it

in highp vec2 v_position;
in highp vec4 v_edges;
flat in highp vec4 v_clip;
in mediump vec4 v_colour;
flat in mediump float v_glyph;

layout(location = 0) out mediump vec4 o_colour;

void main() {
    float coverage;
    if (v_glyph > 0.5) {
        float field = texture(u_atlas, v_edges.xy).r;
        coverage = clamp((field - 0.5) * v_edges.z + v_edges.w + 0.5, 0.0, 1.0);
    } else {
        // Of two opposite edges each takes away what lies beyond it: exact for bars narrower than a pixel.
        vec4 inside = clamp(v_edges + 0.5, 0.0, 1.0);
        coverage = max(inside.x + inside.z - 1.0, 0.0) * max(inside.y + inside.w - 1.0, 0.0);
    }
    vec4 room = vec4(v_position - v_clip.xy, v_clip.zw - v_position);
    coverage *= step(0.0, min(min(room.x, room.y), min(room.z, room.w)));
    float alpha = v_colour.a * coverage;
    o_colour = vec4(v_colour.rgb * alpha, alpha);
}
