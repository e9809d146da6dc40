// One triangle over the whole picture: the fragment shader casts a ray for each pixel.
void main() {
    vec2 p = vec2((gl_VertexID & 1) == 0 ? -1.0 : 3.0, (gl_VertexID & 2) == 0 ? -1.0 : 3.0);
    gl_Position = vec4(p, 0.0, 1.0);
}
