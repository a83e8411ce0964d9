/* A Faust program as a C library: made once, then asked for blocks of sound. */
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>
#ifdef __SSE2__
#include <emmintrin.h>
#endif

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

/* Voices in turn, a block at a time, added up, as hosts play polyphony. Returns the peak of the sum. */
extern "C" double play(mydsp **voices, int64_t n_voices, int64_t n_frames) {
    const int block = 256;
#ifdef __SSE2__
    /* As hosts of Faust do: a decay that reaches subnormal numbers takes no longer. */
    const unsigned before = _mm_getcsr();
    _mm_setcsr(before | 0x8040);
#endif
    const int n_outputs = voices[0]->getNumOutputs();
    std::vector<double> sound(n_outputs * block), sum(block);
    std::vector<double *> channels;
    for (int i = 0; i < n_outputs; i++)
        channels.push_back(sound.data() + i * block);
    double peak = 0.0;
    for (int64_t frame = 0; frame + block <= n_frames; frame += block) {
        std::fill(sum.begin(), sum.end(), 0.0);
        for (int64_t voice = 0; voice < n_voices; voice++) {
            voices[voice]->compute(block, nullptr, channels.data());
            for (int i = 0; i < n_outputs * block; i++)
                sum[i % block] += sound[i];
        }
        for (double x : sum)
            peak = std::isfinite(x) ? std::max(peak, std::fabs(x)) : x;
    }
#ifdef __SSE2__
    _mm_setcsr(before);
#endif
    return peak;
}
