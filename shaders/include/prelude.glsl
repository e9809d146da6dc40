#version 300 es
// Put before every shader by gl::program, the only place where version and default precisions are set.
// Positions and sampled heights need 24 bits everywhere. A colour or a coverage that is happy with 10 bits
// says `mediump` where it is declared.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp isampler2D;
precision highp sampler2DArray;
precision highp usampler2DArray;
