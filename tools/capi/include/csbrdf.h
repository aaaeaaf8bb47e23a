/*
 * csbrdf: measured BRDFs from compressed files, whole, by blocks, or at pairs of directions.
 *
 *     csbrdf_brdf *brdf;
 *     if (csbrdf_open_path("chrome.csbrdf", &brdf) != CSBRDF_OK) {
 *         char message[256];
 *         csbrdf_last_error(message, sizeof message);
 *         ...
 *     }
 *     const double wi[3] = {0.3, 0.0, 0.9}, wo[3] = {-0.5, 0.1, 0.8};
 *     float rgb[3]; // 1/sr
 *     csbrdf_status status = csbrdf_eval(brdf, wi, wo, rgb, 3);
 *     csbrdf_close(brdf);
 *
 * Pointers: NULL where something is needed is CSBRDF_INVALID_ARGUMENT, but an array of length 0 may be NULL. Any
 * other pointer must be valid, aligned for its type, and good for as many elements as the function says. Memory is
 * the caller's, but for handles; what a function writes to must not overlap what it reads. What an output holds
 * after a failure is not specified, but for handles, which are NULL then.
 *
 * Threads: any number of threads may use one handle at the same time, but in what closes or frees it. The
 * message of csbrdf_last_error() is that of the calling thread. Values do not depend on which threads ask, when, or
 * for what else.
 *
 * Failures: every function returns, and none throws. A bug in the library that is caught (CSBRDF_PANIC) also leaves
 * a note on stderr. The program ends only if memory runs out, or if a mapped file shrinks (csbrdf_open_path()).
 *
 * Made by cbindgen from src; `cargo test` in tools/capi tells how to make it anew.
 */

#ifndef CSBRDF_H
#define CSBRDF_H

#include <stddef.h>
#include <stdint.h>

/**
 * Version of the interface in this header. It changes when a program that was compiled with one header cannot use a
 * library built from the other; compare with csbrdf_abi_version().
 */
#define CSBRDF_ABI_VERSION 1

/**
 * csbrdf_options.lookup: linear between bin centres on every axis. The default.
 */
#define CSBRDF_LOOKUP_LINEAR 0

/**
 * csbrdf_options.lookup: the bin that the directions fall into.
 */
#define CSBRDF_LOOKUP_NEAREST 1

/**
 * csbrdf_options.pruned: a block that was pruned from the file is CSBRDF_PRUNED, one that was lost is CSBRDF_LOST. The default.
 */
#define CSBRDF_PRUNED_REFUSE 0

/**
 * csbrdf_options.pruned: a block that was pruned or lost gives its mean.
 */
#define CSBRDF_PRUNED_COARSE 1

/**
 * csbrdf_axis.quantity: anything that this library knows no angle for.
 */
#define CSBRDF_AXIS_OTHER 0

/**
 * csbrdf_axis.quantity: elevation of the half vector, from the normal.
 */
#define CSBRDF_AXIS_THETA_H 1

/**
 * csbrdf_axis.quantity: azimuth of the half vector.
 */
#define CSBRDF_AXIS_PHI_H 2

/**
 * csbrdf_axis.quantity: elevation of the difference vector, from the half vector.
 */
#define CSBRDF_AXIS_THETA_D 3

/**
 * csbrdf_axis.quantity: azimuth of the difference vector.
 */
#define CSBRDF_AXIS_PHI_D 4

/**
 * csbrdf_axis.quantity: elevation of the incident direction.
 */
#define CSBRDF_AXIS_THETA_I 5

/**
 * csbrdf_axis.quantity: azimuth of the incident direction.
 */
#define CSBRDF_AXIS_PHI_I 6

/**
 * csbrdf_axis.quantity: elevation of the outgoing direction.
 */
#define CSBRDF_AXIS_THETA_O 7

/**
 * csbrdf_axis.quantity: azimuth of the outgoing direction.
 */
#define CSBRDF_AXIS_PHI_O 8

/**
 * What came of a call. csbrdf_last_error() has the details. Later versions may add codes.
 */
typedef enum {
    /**
     * It did what was asked.
     */
    CSBRDF_OK = 0,
    /**
     * The operating system refused: the file is missing, or cannot be read or mapped.
     */
    CSBRDF_IO = 1,
    /**
     * The bytes are not a csbrdf file.
     */
    CSBRDF_NOT_CSBRDF = 2,
    /**
     * A csbrdf file of a version that this library does not read.
     */
    CSBRDF_UNSUPPORTED_VERSION = 3,
    /**
     * The file ends before its contents do.
     */
    CSBRDF_TRUNCATED = 4,
    /**
     * The file is damaged, or contradicts itself.
     */
    CSBRDF_CORRUPT = 5,
    /**
     * A size in the file is above the limit in csbrdf_options, or the file takes more time or memory than one may.
     */
    CSBRDF_LIMIT_EXCEEDED = 6,
    /**
     * An argument is NULL or out of its range, an array has the wrong length, or the file cannot answer the question.
     */
    CSBRDF_INVALID_ARGUMENT = 7,
    /**
     * A bug in the library was caught. The handle can still be used and closed.
     */
    CSBRDF_PANIC = 8,
    /**
     * A block that the call needs was pruned from the file, and the options do not allow its mean in its place.
     */
    CSBRDF_PRUNED = 9,
    /**
     * A block that the call needs was lost to damage before the file was repaired, and the options do not allow what is left of it, its
     * mean at best, in its place.
     */
    CSBRDF_LOST = 10,
} csbrdf_status;

/**
 * An open file.
 */
typedef struct csbrdf_brdf csbrdf_brdf;

/**
 * What draws directions where a material reflects. Needs its file no more once it is made.
 */
typedef struct csbrdf_importance csbrdf_importance;

/**
 * How to open a file. A field that is 0 takes its default: start with `csbrdf_options options = {0};` (C++:
 * `csbrdf_options options{};`) and set `options.size = sizeof options`.
 */
typedef struct {
    /**
     * sizeof(csbrdf_options). It says which fields the program knows; later versions append some.
     */
    size_t size;
    /**
     * Most bytes of decoded blocks that the handle keeps for csbrdf_eval(). Default 64 MiB; one block is kept
     * whatever it takes.
     */
    size_t cache_bytes;
    /**
     * Most values (positions times channels) of a block: a file with larger ones is CSBRDF_LIMIT_EXCEEDED. Decoding a
     * block takes 40 bytes a value at most. Default and upper bound 2^24, the most that the format allows.
     */
    size_t max_block_values;
    /**
     * CSBRDF_LOOKUP_LINEAR or CSBRDF_LOOKUP_NEAREST.
     */
    uint32_t lookup;
    /**
     * CSBRDF_PRUNED_REFUSE or CSBRDF_PRUNED_COARSE.
     */
    uint32_t pruned;
    /**
     * Most values (positions times channels) of a table that is decoded as a whole: a larger one is CSBRDF_LIMIT_EXCEEDED.
     * Default 2^28; the defaults of the next two grow with it.
     */
    size_t max_table_values;
    /**
     * Most operations, about a nanosecond of one processor each, that one call may take but for whole tables, and that
     * csbrdf_eval() may take over the life of a handle, besides 4096 for each byte of the file: beyond it the call is
     * CSBRDF_LIMIT_EXCEEDED. Default 10^9.
     */
    uint64_t max_operations;
    /**
     * Most bytes of memory that one call may take beside the caller's buffers and the cache, besides 16 for each byte of
     * the file: beyond it the call is CSBRDF_LIMIT_EXCEEDED. Default 2^28.
     */
    uint64_t max_bytes;
} csbrdf_options;

/**
 * An axis of the grid.
 */
typedef struct {
    /**
     * What it measures: CSBRDF_AXIS_...
     */
    uint32_t quantity;
    /**
     * How its bins are spread: bin coordinate u, bin i from i to i + 1, is the angle start + (end - start) * t, with
     * t = u / bins to this power, 1 (equal bins) or 2 (bins that are narrow near `start`: theta_h of MERL).
     */
    uint32_t power;
    /**
     * Number of bins, at least 1.
     */
    size_t bins;
    /**
     * Angle at the lower edge of the first bin, radians.
     */
    double start;
    /**
     * Angle at the upper edge of the last bin, radians.
     */
    double end;
} csbrdf_axis;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * CSBRDF_ABI_VERSION of the library.
 */
uint32_t csbrdf_abi_version(void);

/**
 * Version of the library, such as "1.0.0". The string is never freed.
 */
const char *csbrdf_version(void);

/**
 * Copies the message of the calling thread's last call that failed, in English and UTF-8, into `buffer`: at most
 * `size` bytes with the terminating NUL, cut between characters. Calls that succeed leave the message as it is.
 *
 * Returns the length of the whole message in bytes, without the NUL (as snprintf does): it was cut if that is `size`
 * or more. 0 if no call has failed. `buffer` may be NULL to ask for the length alone.
 */
size_t csbrdf_last_error(char *buffer,
                         size_t size);

/**
 * Opens the file at a path in UTF-8 (NUL-terminated) and puts a handle to close into `*out`, or NULL on failure.
 * Reads and checks the header and the index; blocks are read when they are first needed.
 *
 * The file is mapped into memory. It may be replaced by renaming another over it, but must not be written to or
 * truncated while the handle is open: the process would end by SIGBUS. Where that can happen, read it and use
 * csbrdf_open_memory().
 */
csbrdf_status csbrdf_open_path(const char *utf8_path,
                               csbrdf_brdf **out);

/**
 * As csbrdf_open_path(), with options; NULL for the default ones.
 */
csbrdf_status csbrdf_open_path_with(const char *utf8_path, const csbrdf_options *options, csbrdf_brdf **out);

/**
 * Opens a file of `size` bytes in memory, which are copied, and puts a handle to close into `*out`, or NULL on
 * failure.
 */
csbrdf_status csbrdf_open_memory(const uint8_t *data,
                                 size_t size,
                                 csbrdf_brdf **out);

/**
 * As csbrdf_open_memory(), with options; NULL for the default ones.
 */
csbrdf_status csbrdf_open_memory_with(const uint8_t *data,
                                      size_t size,
                                      const csbrdf_options *options,
                                      csbrdf_brdf **out);

/**
 * Closes a handle; NULL is allowed and does nothing. No other call may be using the handle, nor use it afterwards.
 */
void csbrdf_close(csbrdf_brdf *brdf);

/**
 * Number of axes of the grid, 1 to 4.
 */
csbrdf_status csbrdf_axis_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of channels, 1 to 4096: 3 for R, G, B.
 */
csbrdf_status csbrdf_channel_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of blocks, at least 1.
 */
csbrdf_status csbrdf_block_count(const csbrdf_brdf *brdf, size_t *count);

/**
 * Number of bins along each axis, slowest axis first, with ones in front where there are fewer than four axes: 1, 90,
 * 90, 180 for MERL's theta_h, theta_d, phi_d.
 */
csbrdf_status csbrdf_grid_shape(const csbrdf_brdf *brdf,
                                size_t shape[4]);

/**
 * Number of values of the whole table: positions of the grid times channels. The length that csbrdf_decode_all()
 * needs.
 */
csbrdf_status csbrdf_table_size(const csbrdf_brdf *brdf,
                                size_t *values);

/**
 * Number of values of a block: its positions times channels. The length that csbrdf_decode_block() needs.
 */
csbrdf_status csbrdf_block_size(const csbrdf_brdf *brdf, size_t block, size_t *values);

/**
 * Where a block stands: position of its first bin and its bins along each axis, both in the axes of
 * csbrdf_grid_shape().
 */
csbrdf_status csbrdf_block_box(const csbrdf_brdf *brdf, size_t block, size_t origin[4], size_t shape[4]);

/**
 * Decodes one block into `out`, BRDF in 1/sr: one channel after the other, each the block's box with the last axis
 * fastest. Bins that were not measured hold what the encoder filled in.
 *
 * `length` must be what csbrdf_block_size() gives.
 */
csbrdf_status csbrdf_decode_block(const csbrdf_brdf *brdf,
                                  size_t block,
                                  float *out,
                                  size_t length);

/**
 * Decodes the whole table into `out`, BRDF in 1/sr: one channel after the other, each of the shape of the grid with
 * the last axis fastest. Bins that were not measured hold what the encoder filled in. Needs no more memory than one
 * block's besides `out`.
 *
 * `length` must be what csbrdf_table_size() gives.
 */
csbrdf_status csbrdf_decode_all(const csbrdf_brdf *brdf,
                                float *out,
                                size_t length);

/**
 * BRDF in 1/sr of each channel, for light from `wi` and view to `wo`: vectors x, y, z away from the surface in its
 * frame, z along the normal, of any length. 0 if one points below the horizon, is zero or not finite.
 *
 * `channels` is the length of `out` and must be what csbrdf_channel_count() gives. CSBRDF_INVALID_ARGUMENT if the
 * axes of the file are not angles of directions.
 */
csbrdf_status csbrdf_eval(const csbrdf_brdf *brdf,
                          const double wi[3],
                          const double wo[3],
                          float *out,
                          size_t channels);

/**
 * csbrdf_eval() of `count` pairs of directions: `wi` and `wo` hold x, y, z of one after the other (3 * count values),
 * `out` receives all channels of the first pair, then those of the second, and so on.
 *
 * `length` is that of `out`, count times what csbrdf_channel_count() gives.
 */
csbrdf_status csbrdf_eval_many(const csbrdf_brdf *brdf,
                               size_t count,
                               const double *wi,
                               const double *wo,
                               float *out,
                               size_t length);

/**
 * What an axis measures, from where to where. `axis` counts from 0, the slowest, to what csbrdf_axis_count() gives, less
 * one; unlike csbrdf_grid_shape() there are no axes of one bin in front.
 */
csbrdf_status csbrdf_grid_axis(const csbrdf_brdf *brdf,
                               size_t axis,
                               csbrdf_axis *out);

/**
 * Name of a channel in UTF-8, such as "R": at most `size` bytes with the terminating NUL go to `name`, cut between
 * characters; `*wavelength` becomes its centre in nanometres, 0 for broad-band channels such as R, G, B.
 *
 * `wavelength` may be NULL, and so may `name` if `size` is 0. 256 bytes are enough for every name. The format allows any
 * character in a name: to C, one with a NUL within ends there.
 */
csbrdf_status csbrdf_channel(const csbrdf_brdf *brdf,
                             size_t channel,
                             char *name,
                             size_t size,
                             double *wavelength);

/**
 * Which values of a block were measured: 1 for each that was, 0 for each that the encoder filled in, in the order of
 * csbrdf_decode_block(). In a block that was pruned none counts as measured.
 *
 * `length` must be what csbrdf_block_size() gives.
 */
csbrdf_status csbrdf_block_validity(const csbrdf_brdf *brdf,
                                    size_t block,
                                    uint8_t *out,
                                    size_t length);

/**
 * Decodes the file once, some 50 ms for a MERL table on one thread, and puts what draws directions for it into `*out`,
 * to be freed by csbrdf_importance_free(), or NULL on failure. It takes some 100 kB and does not refer to `brdf`.
 *
 * Files with other axes than half and difference angles draw by the cosine alone. Blocks that were pruned draw few
 * directions, unless the options allow their means.
 */
csbrdf_status csbrdf_importance_new(const csbrdf_brdf *brdf,
                                    csbrdf_importance **out);

/**
 * Frees what csbrdf_importance_new() made; NULL is allowed and does nothing. No other call may be using it, nor use
 * it afterwards.
 */
void csbrdf_importance_free(csbrdf_importance *importance);

/**
 * Draws a direction for `wi` (as in csbrdf_eval()) by two numbers from 0 to below 1: `wo` becomes a unit vector above
 * the horizon, `*pdf` its density in 1/sr, positive. A BRDF is reciprocal: light and view may change places.
 *
 * CSBRDF_INVALID_ARGUMENT if `wi` is zero, not finite, or not above the horizon.
 */
csbrdf_status csbrdf_importance_sample(const csbrdf_importance *importance,
                                       const double wi[3],
                                       const double u[2],
                                       double wo[3],
                                       double *pdf);

/**
 * Density in 1/sr of csbrdf_importance_sample() at `wo` for `wi`; it integrates to 1 over the hemisphere of `wo`. 0 if
 * one of them is zero, not finite, or not above the horizon.
 */
csbrdf_status csbrdf_importance_pdf(const csbrdf_importance *importance,
                                    const double wi[3],
                                    const double wo[3],
                                    double *pdf);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CSBRDF_H */
