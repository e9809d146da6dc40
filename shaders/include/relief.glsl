// The colour of the ground from what is stored of it: shared by the clipmap and the one-piece Earth, so that nothing jumps
// where one takes over from the other. Put before both by gl::look.
// Colours follow AC 25-11B table 5-1 (earth tan and brown); water is blue and missing data violet on black, and neither
// colour occurs on land.
uniform vec3 key;             // towards the lights, as long as they are strong: east, north, up
uniform vec3 fill;
uniform vec4 haze;            // colour; 1 / distance at which half of it is reached, 1/m
uniform vec3 brightness;      // of everything: 1 by day
#ifdef AWARENESS
uniform vec3 warning;         // colours of ground that is too high, and of ground that is close
uniform vec3 caution;
uniform vec2 margin;          // height where the warning begins, m; height of the caution's band below it, m
#endif
#ifdef GRID
uniform vec4 ink;             // of the lines; the last one is their opacity
#endif

// Bottom of a valley to summit, as slopes added up: a clamp costs nothing on these GPUs.
vec3 tint(float height) {
    vec3 c = vec3(0.27, 0.43, 0.22);
    c += vec3(0.16, 0.08, 0.04) * clamp(height * (1.0 / 900.0), 0.0, 1.0);
    c += vec3(0.20, 0.05, 0.10) * clamp((height - 900.0) * (1.0 / 1100.0), 0.0, 1.0);
    c += vec3(-0.04, -0.10, -0.03) * clamp((height - 2000.0) * (1.0 / 900.0), 0.0, 1.0);
    c += vec3(0.05, 0.10, 0.18) * clamp((height - 2900.0) * (1.0 / 1000.0), 0.0, 1.0);
    return c + vec3(0.31, 0.39, 0.44) * clamp((height - 3900.0) * (1.0 / 1400.0), 0.0, 1.0);
}

// s: a texel of the surface (normal east and north, crest, kind: terrain::surface); height in metres; `path`: metres of
// hazy air before it; `lines`: position in the grid of lines, one unit from one to the next.
vec3 ground(vec4 s, float height, float path, vec2 lines) {
    // Byte 128 is exactly 0.
    vec3 code = s.xyz * (255.0 / 127.0) - (128.0 / 127.0);
    vec2 slope = code.xy * (0.5 + 0.5 * abs(code.xy));
    float up2 = max(1.0 - dot(slope, slope), 0.0);
    float up = sqrt(up2);
    // Steep ground shows its rock; gentle relief is drawn steeper than it is, so that a plain is not a blank.
    float steep = clamp((0.92 - up) * 3.0, 0.0, 1.0);
    vec3 land = mix(tint(height), vec3(0.42, 0.40, 0.39), 0.6 * steep);
    vec3 sea = vec3(0.10, 0.34, 0.62);
    float wet = clamp(4.0 - 12.0 * s.w, 0.0, 1.0);
    // Lit as a normal that leans that much more, whose length is divided out at the end.
    float lean = 2.6 - 1.2 * steep;
    float shine = max(lean * dot(slope, key.xy) + up * key.z, 0.0) + max(lean * dot(slope, fill.xy) + up * fill.z, 0.0);
    float light = 0.26 + shine * inversesqrt(lean * lean * (1.0 - up2) + up2);
    // Crests are lighter and hollows darker from wherever the light comes: this is what sets a ridge off from the next.
    light *= 1.0 + 0.6 * code.z;
    light = mix(light, 1.0, wet);
    vec3 colour = mix(land, sea, wet);
    float veil = 0.75 - 0.75 * exp2(-path * haze.w);
#ifdef AWARENESS
    // Heights above the beginning of the warning, metres. A dark line stands along both limits, and the warning is barred:
    // its colour is not its only mark.
    float over = height - margin.x;
    float bars = 0.62 + 0.38 * step(0.3, fract((gl_FragCoord.x - gl_FragCoord.y) * (1.0 / 10.0)));
    float close = step(-margin.y, over);
    colour = over > 0.0 ? mix(colour, warning, 0.8) * bars : mix(colour, caution, 0.7 * close);
    veil *= 1.0 - 0.6 * close;
    float edge = min(abs(over), abs(over + margin.y)) / max(fwidth(height), 1e-3);
    light *= clamp(edge - 0.5, 0.15, 1.0);
#endif
    colour *= light;
    // Hatching that stands still on the screen: no terrain moves like that.
    float stripe = step(0.5, fract((gl_FragCoord.x + gl_FragCoord.y) * (1.0 / 12.0)));
    colour = s.w > 0.75 ? mix(vec3(0.10, 0.05, 0.12), vec3(0.42, 0.16, 0.50), stripe) : colour;
#ifdef GRID
    // A line is 1.5 pixels wide wherever it runs; where lines come closer than 12 pixels, they fade before they merge.
    vec2 across = dFdx(lines);
    vec2 up_screen = dFdy(lines);
    vec2 pixel = max(sqrt(across * across + up_screen * up_screen), 1e-7);
    vec2 away = abs(fract(lines - 0.5) - 0.5) / pixel;
    vec2 line = clamp(1.25 - away, 0.0, 1.0) * clamp(1.5 - 12.0 * pixel, 0.0, 1.0);
    colour = mix(colour, ink.rgb, ink.a * max(line.x, line.y));
#endif
    return mix(colour, haze.rgb, veil) * brightness;
}
