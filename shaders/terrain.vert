// A vertex of the terrain: from a block's pattern to a post of its level, and from that to a position on the ellipsoid.
// In: the pattern's vertex and the block (cells from the window's origin). Out: clip position; texel coordinates in the
// level's own and the coarser level's surface; height and blend. Positions are metres in Earth-centred axes, from the eye.
// Positions must come out the same bits wherever a vertex is shared, hence `invariant` and one expression for all levels.
layout(location = 0) in uvec2 corner;
layout(location = 1) in uvec4 block;

uniform usampler2D heights;   // own code, code of the coarser level's surface; toroidal
uniform sampler2D tables;     // columns and rows, see terrain::tables
uniform ivec4 window;         // origin's texel east and north; row of the tables; cells across
uniform ivec2 torus;          // texels less one; anchor's height code
uniform vec4 morph;           // centre east and north, start, 1 / (end - start); cells from the origin
uniform vec4 texels;          // own origin, coarser origin times two; texels
uniform vec3 origin;          // anchor less eye, metres
uniform vec4 scale;           // of a column's first two, m; m per code; 1 / texels; height of code 0, m
uniform vec3 clip_x;
uniform vec3 clip_y;
uniform vec3 clip_w;
uniform vec2 depth;           // clip z = depth.x w + depth.y
#ifdef CAP
uniform vec4 bulge;           // see terrain::tables::Anchor::bulge
#endif

out vec4 v_texel;             // own surface, coarser surface
out vec2 v_ground;            // height above the ellipsoid, m; blend into the coarser level, 0 to 1
#ifdef RANGE
out vec3 v_position;
#endif
#ifdef GRID
uniform vec3 lines_at;        // the window's origin among the lines, east and north; a cell; steps from line to line
out vec2 v_lines;             // position among the lines: whole numbers are on one
#endif

invariant gl_Position;

void main() {
    ivec4 b = ivec4(block);
    int parity = (b.x + b.y) & 1;
    ivec2 cell = b.xy + clamp(ivec2(corner) - ivec2(parity, 0), ivec2(0), b.zw);
    // On the window's outer edge only the posts that the coarser level has too.
    ivec2 even = cell & ~1;
    bool side = cell.x == 0 || cell.x == window.w;
    bool end = cell.y == 0 || cell.y == window.w;
    cell = ivec2(end ? even.x : cell.x, side ? even.y : cell.y);

    ivec2 codes = ivec2(texelFetch(heights, (cell + window.xy) & torus.x, 0).xy) - torus.y;
    vec4 column = texelFetch(tables, ivec2(cell.x, window.z), 0);
    vec4 row = texelFetch(tables, ivec2(cell.y, window.z + 1), 0);

    vec2 at = vec2(cell);
    vec2 away = abs(at - morph.xy);
    float blend = clamp((max(away.x, away.y) - morph.z) * morph.w, 0.0, 1.0);
    // 0 and 1 give exactly one of the two.
    float rise = (float(codes.x) * (1.0 - blend) + float(codes.y) * blend) * scale.y;

#ifdef CAP
    // z and x of the sphere through the anchor; then what the radius of curvature has more than there, and the height.
    vec2 across = scale.x * column.xy + row.x * column.zw;
    vec3 up = vec3(row.z * column.w, row.w, row.z * column.z);
    float x = bulge.x * across.x * (up.z + bulge.y);
    float more = x * (1.0 + 0.75 * x) * bulge.z;
    vec3 p = origin + vec3(across.y, row.y, bulge.w * across.x)
        + vec2(more + rise, 0.9933056 * more + rise).xxy * up;
#else
    vec3 p = origin + vec3(scale.x * column.xy + row.x * column.zw, row.y)
        + rise * vec3(row.z * column.zw, row.w);
#endif
    float w = dot(clip_w, p);
    gl_Position = vec4(dot(clip_x, p), dot(clip_y, p), depth.x * w + depth.y, w);

    v_texel = vec4(at + texels.xy + 0.5, (at + texels.zw) * 0.5 + 0.5) * scale.z;
    v_ground = vec2(rise + float(torus.y) * scale.y + scale.w, blend);
#ifdef RANGE
    v_position = p;
#endif
#ifdef GRID
    v_lines = at * lines_at.z + lines_at.xy;
#endif
}
