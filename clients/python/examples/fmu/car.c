/* A single-track car with linear tyres as a co-simulation FMU: FMI 1.0, 2.0 and 3.0 in one library, written against the
   standards' signatures without their headers. SI units, x forward, y left, centre of gravity. Built by build.py. */

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

/* Value references, in the order of build.py. */
enum { STEER = 1, FORCE, FRONT, REAR, X, Y, YAW, V, YAW_RATE, AX, AY, V0, VY0, YAW_RATE0, MASS, INERTIA, LF, LR, CF, CR, ROLLING, DRAG, COUNT };

typedef struct {
    double value[COUNT];
    double vy;
} Car;

static const double STARTS[COUNT] = { [V0] = 10, [MASS] = 1500, [INERTIA] = 2500, [LF] = 1.3, [LR] = 1.5, [CF] = 90000, [CR] = 100000, [ROLLING] = 0.1, [DRAG] = 0.6 };

static void begin(Car *c) {
    memcpy(c->value, STARTS, sizeof STARTS);
    c->vy = 0;
}

static void initialised(Car *c) {
    double *u = c->value;
    u[X] = u[Y] = u[YAW] = u[AX] = u[AY] = 0;
    u[V] = u[V0], u[YAW_RATE] = u[YAW_RATE0], c->vy = u[VY0];
}

static void fine_step(Car *c, double h) {
    double *u = c->value, v = fmax(u[V], 0.5), r = u[YAW_RATE];
    double front = u[CF] * (u[STEER] - (c->vy + u[LF] * r) / v) + u[FRONT];
    double rear = u[CR] * -(c->vy - u[LR] * r) / v + u[REAR];
    double resist = u[V] > 0 ? u[ROLLING] * u[MASS] + u[DRAG] * u[V] * u[V] : 0;
    u[AX] = (u[FORCE] - resist - front * sin(u[STEER])) / u[MASS];
    u[AY] = (front * cos(u[STEER]) + rear) / u[MASS];
    u[V] = fmax(0, u[V] + h * (u[AX] + c->vy * r));
    c->vy += h * (u[AY] - u[V] * r);
    u[YAW_RATE] += h * (u[LF] * front * cos(u[STEER]) - u[LR] * rear) / u[INERTIA];
    u[X] += h * (u[V] * cos(u[YAW]) - c->vy * sin(u[YAW]));
    u[Y] += h * (u[V] * sin(u[YAW]) + c->vy * cos(u[YAW]));
    u[YAW] += h * u[YAW_RATE];
}

static int step(Car *c, double h) {
    int n = (int)ceil(h / 0.002);
    double ax = 0, ay = 0;
    for (int k = 0; k < n; k++) {
        fine_step(c, h / n);
        ax += c->value[AX] / n, ay += c->value[AY] / n;
    }
    c->value[AX] = ax, c->value[AY] = ay;
    return 0;
}

static int get(Car *c, const unsigned *which, size_t n, double *out) {
    for (size_t k = 0; k < n; k++) out[k] = c->value[which[k]];
    return 0;
}

static int set(Car *c, const unsigned *which, size_t n, const double *in) {
    for (size_t k = 0; k < n; k++) c->value[which[k]] = in[k];
    return 0;
}

static void *made(void) {
    Car *c = malloc(sizeof *c);
    if (c) begin(c);
    return c;
}

/* FMI 1.0: names begin with the model's */
typedef struct { void *log, *allocate, *release, *finished; } Callbacks;
const char *car_fmiGetVersion(void) { return "1.0"; }
const char *car_fmiGetTypesPlatform(void) { return "standard32"; }
void *car_fmiInstantiateSlave(const char *name, const char *guid, const char *place, const char *mime, double patience, char visible, char interactive, Callbacks callbacks, char logging) { return made(); }
void car_fmiFreeSlaveInstance(void *c) { free(c); }
int car_fmiInitializeSlave(void *c, double start, char stops, double stop) { return initialised(c), 0; }
int car_fmiTerminateSlave(void *c) { return 0; }
int car_fmiResetSlave(void *c) { return begin(c), 0; }
int car_fmiGetReal(void *c, const unsigned *which, size_t n, double *out) { return get(c, which, n, out); }
int car_fmiSetReal(void *c, const unsigned *which, size_t n, const double *in) { return set(c, which, n, in); }
int car_fmiDoStep(void *c, double at, double h, char fresh) { return step(c, h); }

/* FMI 2.0 */
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks, int visible, int logging) { return made(); }
void fmi2FreeInstance(void *c) { free(c); }
int fmi2SetupExperiment(void *c, int tolerant, double tolerance, double start, int stops, double stop) { return 0; }
int fmi2EnterInitializationMode(void *c) { return 0; }
int fmi2ExitInitializationMode(void *c) { return initialised(c), 0; }
int fmi2Terminate(void *c) { return 0; }
int fmi2Reset(void *c) { return begin(c), 0; }
int fmi2GetReal(void *c, const unsigned *which, size_t n, double *out) { return get(c, which, n, out); }
int fmi2SetReal(void *c, const unsigned *which, size_t n, const double *in) { return set(c, which, n, in); }
int fmi2DoStep(void *c, double at, double h, int keep) { return step(c, h); }

/* FMI 3.0 */
const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging, bool events, bool early, const unsigned *needed, size_t count, void *environment, void *log, void *update) { return made(); }
void fmi3FreeInstance(void *c) { free(c); }
int fmi3EnterInitializationMode(void *c, bool tolerant, double tolerance, double start, bool stops, double stop) { return 0; }
int fmi3ExitInitializationMode(void *c) { return initialised(c), 0; }
int fmi3Terminate(void *c) { return 0; }
int fmi3Reset(void *c) { return begin(c), 0; }
int fmi3GetFloat64(void *c, const unsigned *which, size_t n, double *out, size_t values) { return get(c, which, n, out); }
int fmi3SetFloat64(void *c, const unsigned *which, size_t n, const double *in, size_t values) { return set(c, which, n, in); }
int fmi3DoStep(void *c, double at, double h, bool keep, bool *event, bool *end, bool *early, double *last) {
    *event = *end = *early = false, *last = at + h;
    return step(c, h);
}
