// Sky above zero pitch, haze and ground below it. The pilot's horizon is at zero pitch; the terrain's own limb lies lower
// by the dip, and what is between them must not be blue.
in vec3 v_direction;
uniform vec3 up;              // unit vector away from the Earth, in eye axes
uniform vec3 haze;
uniform vec4 brightness;      // of everything: 1 by day; the air overhead: 1 near the ground, 0 in space

out vec4 o_colour;

void main() {
    float elevation = asin(clamp(dot(normalize(v_direction), up), -1.0, 1.0));
    // Half a pixel of smoothing across the line.
    float edge = max(fwidth(elevation), 1e-6);
    // What air there is lies low: higher up, the sky is black overhead first.
    float air = mix(exp(-4.0 * max(elevation, 0.0)), 1.0, brightness.w);
    vec3 sky = air * mix(vec3(0.50, 0.72, 0.93), vec3(0.09, 0.34, 0.74), smoothstep(0.0, 0.6, elevation));
    vec3 ground = mix(haze, vec3(0.47, 0.38, 0.27), smoothstep(0.0, 0.22, -elevation));
    vec3 colour = mix(ground, sky, smoothstep(-0.5 * edge, 0.5 * edge, elevation));
    o_colour = vec4(colour * brightness.rgb, 1.0);
}
