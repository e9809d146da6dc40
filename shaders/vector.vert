// Instruments: smooth polygons and glyphs over whatever is in the target.
// In: pixels from the upper left corner, y down (draw::list::Vertex). Out: clip space, depth 0.

uniform vec2 u_to_clip; // 2 / width, 2 / height of the target in pixels

layout(location = 0) in vec2 a_position;  // pixels
layout(location = 1) in vec4 a_edges;     // solid: distances to the edges, pixels; glyph: u, v, field scale, fattening
layout(location = 2) in vec4 a_clip;      // left, top, right, bottom, pixels
layout(location = 3) in vec4 a_colour;    // straight alpha
layout(location = 4) in uint a_glyph;     // 0: solid

out highp vec2 v_position;                // pixels
out highp vec4 v_edges;
flat out highp vec4 v_clip;
out mediump vec4 v_colour;
flat out mediump float v_glyph;           // 0: solid, 1: glyph

void main() {
    v_position = a_position;
    v_edges = a_edges;
    v_clip = a_clip;
    v_colour = a_colour;
    v_glyph = a_glyph == 0u ? 0.0 : 1.0;
    gl_Position = vec4(a_position.x * u_to_clip.x - 1.0, 1.0 - a_position.y * u_to_clip.y, 0.0, 1.0);
}
