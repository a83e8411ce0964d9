/* A Faust program as a C library: made once, then asked for blocks of sound. */
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

/* What Faust's code expects of its surroundings; no controls, no metadata. */
struct dsp { virtual ~dsp() {} };
struct Meta { void declare(const char *, const char *) {} };
struct UI {
    void openVerticalBox(const char *) {}
    void closeBox() {}
};

<<includeIntrinsic>>
<<includeclass>>

extern "C" mydsp *begin(int64_t rate) {
    mydsp *made = new mydsp();
    made->init(int(rate));
    return made;
}

extern "C" void end(mydsp *made) { delete made; }

/* out: (n_outputs, n_frames) */
extern "C" void compute(mydsp *made, int64_t n_frames, double *out) {
    std::vector<double *> channels;
    for (int i = 0; i < made->getNumOutputs(); i++)
        channels.push_back(out + i * n_frames);
    made->compute(int(n_frames), nullptr, channels.data());
}

extern "C" int outputs(mydsp *made) { return made->getNumOutputs(); }
