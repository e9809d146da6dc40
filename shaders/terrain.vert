// A vertex of the terrain: from a block's pattern to a post of its level, and from that to a position on the ellipsoid.
// In: the pattern's vertex, by its number, and the block (posts from the window's origin). Out: clip position; coordinates
// in the level's surface; height and blend. Positions are metres in Earth-centred axes, from the eye.
// Positions must come out the same bits wherever a vertex is shared, hence `invariant` and one expression for all levels.
layout(location = 0) in ivec4 block;   // first and last column, first and last row

uniform usampler2D heights;   // own code, code of the coarser level's surface; toroidal
uniform sampler2D tables;     // columns and rows, toroidal like the heights, see terrain::tables
uniform ivec4 window;         // origin's texel east and north; row of the tables; cells across what is drawn
uniform ivec2 torus;          // texels less one; anchor's height code
uniform vec4 morph;           // centre east and north, cells from the origin; at the centre, for each cell from it
uniform vec3 texels;          // the origin's coordinates in the surface; from one texel to the next
uniform vec3 origin;          // anchor less eye, metres
uniform vec2 scale;           // metres a code; the anchor's height above the ellipsoid, m
uniform vec3 clip_x;
uniform vec3 clip_y;
uniform vec3 clip_w;
uniform vec2 depth;           // clip z = depth.x w + depth.y
#ifdef CAP
uniform vec4 bulge;           // see terrain::tables::Anchor::bulge
#endif

out vec2 v_texel;             // in the level's own surface
out vec2 v_ground;            // height above the ellipsoid, m; blend into the coarser level, 0 to 1
#ifdef RANGE
out vec3 v_position;
#endif
#ifdef RECORD
out vec4 v_vertex;            // cell east and north, height above the anchor in m, blend
#endif

invariant gl_Position;

void main() {
    // An odd block begins a column late, see terrain::blocks.
    int odd = (block.x + block.z) & 1;
    ivec2 cell = ivec2(gl_VertexID & 31, gl_VertexID >> 5) + ivec2(block.x - odd, block.z);
    cell = ivec2(clamp(cell.x, block.x, block.y), min(cell.y, block.w));
    // On the outer edge only the posts that the coarser level has too: all bits but the lowest there, else all.
    cell &= min(min(cell, window.w - cell) - 2, -1).yx;

    ivec2 texel = (cell + window.xy) & torus.x;
    ivec2 codes = ivec2(texelFetch(heights, texel, 0).xy);
    vec4 column = texelFetch(tables, ivec2(texel.x, window.z), 0);
    vec4 row = texelFetch(tables, ivec2(texel.y, window.z + 1), 0);

    vec2 at = vec2(cell);
    vec2 away = abs(at - morph.xy);
    float blend = clamp(max(away.x, away.y) * morph.w + morph.z, 0.0, 1.0);
    // Codes above the anchor: whole numbers of 17 bits, so that 0 and 1 give exactly one of the two.
    float rise = float(codes.x - torus.y) + float(codes.y - codes.x) * blend;

#ifdef CAP
    // z and x of the sphere through the anchor; then what the radius of curvature has more than there, and the height.
    vec2 across = column.xy + row.x * column.zw;
    vec3 up = vec3(row.z * column.w, row.w, row.z * column.z);
    float more = bulge.x * across.x * (up.z + bulge.y);
    more += more * more * bulge.z;
    vec3 p = origin + vec3(across.y, row.y, bulge.w * across.x)
        + vec2(more + rise, 0.9933056 * more + rise).xxy * up;
#else
    vec3 p = origin + vec3(column.xy + row.x * column.zw, row.y)
        + vec3(rise * row.z * column.zw, rise * row.w);
#endif
    float w = dot(clip_w, p);
    gl_Position = vec4(dot(clip_x, p), dot(clip_y, p), depth.x * w + depth.y, w);

    v_texel = at * texels.z + texels.xy;
    v_ground = vec2(rise * scale.x + scale.y, blend);
#ifdef RANGE
    v_position = p;
#endif
#ifdef RECORD
    v_vertex = vec4(at, rise * scale.x, blend);
#endif
}
