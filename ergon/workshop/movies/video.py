"""Pictures and sound into a video file, by PyAV (an extra: libraries of FFmpeg)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from typing import IO, TYPE_CHECKING, Any, cast

from ergon.common.errors import ErgonError
from ergon.common.extras import install_command

if TYPE_CHECKING:
    import numpy as np
    from av.video.stream import VideoStream
    from numpy.typing import NDArray

# For each suffix: container format, video codec, sound codec, options of the video codec. Constant
# quality, since fine lines on black need it.
_CODECS_BY_SUFFIX: dict[str, tuple[str, str, str, dict[str, str]]] = {
    ".webm": (
        "webm",
        "libvpx-vp9",
        "libopus",
        {"crf": "24", "b": "0", "deadline": "good", "cpu-used": "4", "row-mt": "1"},
    ),
    ".mp4": ("mp4", "libx264", "aac", {"crf": "20", "preset": "medium"}),
}
SUFFIXES = tuple(_CODECS_BY_SUFFIX)
_BT709, _LIMITED_RANGE = 1, 1  # ITU-T H.273
_SOUND_RATE = 48_000  # Hz, which Opus is made for
_SOUND_BITS_PER_SECOND = 192_000  # a second


class VideoError(ErgonError, RuntimeError):
    """A video file cannot be written; the message says why, and what to do."""


@dataclass(frozen=True, slots=True)
class Sound:
    """Sound of a film: blocks (n_frames, n_out) in the range -1 to 1, and their rate [Hz]."""

    blocks: Iterable[NDArray[np.float64]]
    rate: int
    n_channels: int


def check_pyav() -> None:
    """Raise VideoError where PyAV is not installed."""
    try:
        import av  # noqa: F401
    except ImportError:
        reason = f"films need PyAV: {install_command('movie')}; or write pictures: --movie FOLDER/"
        raise VideoError(reason) from None


class VideoFile:
    """A video file that pictures are added to, one after the other, with their sound."""

    def __init__(
        self, file: IO[bytes], suffix: str, size: tuple[int, int], rate: int, sound: Sound | None
    ) -> None:
        """`size`: width and height [px], both even; `rate`: pictures a second.

        Raises VideoError where PyAV is not installed or lacks a codec.
        """
        check_pyav()
        import av

        self._av = av
        format, video_codec, sound_codec, codec_options = _CODECS_BY_SUFFIX[suffix]
        try:
            self._container: Any = av.open(file, "w", format=format)
            stream = self._container.add_stream(video_codec, rate=rate, options=codec_options)
            self._video = cast("VideoStream", stream)
            self._video.width, self._video.height = size
            self._video.pix_fmt = "yuv420p"
            self._video.codec_context.colorspace = _BT709
            self._video.codec_context.color_primaries = _BT709
            self._video.codec_context.color_trc = _BT709
            self._video.codec_context.color_range = _LIMITED_RANGE
            self._sound_stream = (
                None if sound is None else self._add_sound_stream(sound_codec, sound)
            )
        except av.error.FFmpegError as error:
            raise VideoError(f"this PyAV cannot write {suffix} files: {error}") from None
        self._picture_rate = rate
        self._n_pictures = 0

    def _add_sound_stream(self, codec: str, sound: Sound) -> _SoundStream:
        return _SoundStream(self._av, self._container, codec, sound)

    def add(self, png: bytes) -> None:
        """Add a picture, a PNG file, and the sound up to its end."""
        # A decoder of its own for each: one that goes on adds a picture to the one before.
        for picture_frame in self._av.CodecContext.create("png", "r").decode(self._av.Packet(png)):
            pixels = picture_frame.to_ndarray(format="rgb24")
            # The usual coding of films: BT.709, levels from 16 to 235.
            picture = self._av.VideoFrame.from_ndarray(pixels, format="rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            picture.pts, picture.time_base = self._n_pictures, Fraction(1, self._picture_rate)
            self._container.mux(self._video.encode(picture))
        self._n_pictures += 1
        if self._sound_stream is not None:
            self._sound_stream.encode_until(self._n_pictures / self._picture_rate)

    def close(self) -> None:
        """Write what is left."""
        self._container.mux(self._video.encode(None))
        if self._sound_stream is not None:
            self._sound_stream.flush()
        self._container.close()

    def discard(self) -> None:
        """Release the codecs; what is not written yet is lost."""
        self._container.close()


class _SoundStream:
    """The sound of a film, encoded as far as its pictures are."""

    def __init__(self, av: Any, container: Any, codec: str, sound: Sound) -> None:
        self._av, self._container, self._sound = av, container, sound
        layout = "mono" if sound.n_channels == 1 else "stereo"
        self._stream = container.add_stream(codec, rate=_SOUND_RATE, layout=layout)
        self._stream.bit_rate = _SOUND_BITS_PER_SECOND
        self._resampler = av.AudioResampler(
            format=self._stream.format, layout=layout, rate=_SOUND_RATE
        )
        self._layout = layout
        self._blocks: Iterator[NDArray[np.float64]] = iter(sound.blocks)
        self._n_encoded = 0  # frames that were encoded

    def encode_until(self, time: float) -> None:
        """Encode the sound up to an instant [s] of the film, as far as there is any."""
        while self._n_encoded < time * self._sound.rate:
            block = next(self._blocks, None)
            if block is None:
                return
            self._encode(block)

    def flush(self) -> None:
        """Encode what the codec holds."""
        for frame in self._resampler.resample(None):
            self._container.mux(self._stream.encode(frame))
        self._container.mux(self._stream.encode(None))

    def _encode(self, block: NDArray[np.float64]) -> None:
        import numpy as np

        samples = np.ascontiguousarray(block.reshape(1, -1), dtype=np.float32)
        audio_frame = self._av.AudioFrame.from_ndarray(samples, format="flt", layout=self._layout)
        audio_frame.rate = self._sound.rate
        audio_frame.pts, audio_frame.time_base = self._n_encoded, Fraction(1, self._sound.rate)
        self._n_encoded += len(block)
        for resampled in self._resampler.resample(audio_frame):
            self._container.mux(self._stream.encode(resampled))
