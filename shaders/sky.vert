// One triangle over the whole picture at the far end of depth. Out: the view direction in eye axes (x right, y up, z
// backwards), not of unit length.
uniform vec2 extent;          // tangents of half the field of view, across and up
out vec3 v_direction;

void main() {
    vec2 p = vec2((gl_VertexID & 1) == 0 ? -1.0 : 3.0, (gl_VertexID & 2) == 0 ? -1.0 : 3.0);
    v_direction = vec3(p * extent, -1.0);
    gl_Position = vec4(p, 1.0, 1.0);
}
