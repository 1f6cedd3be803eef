// Statistics of the state after a step, if they are asked for.

@group(1) @binding(0) var<storage, read> gauges: array<StrainGauge>;
@group(1) @binding(1) var<storage, read> x: array<vec4f>;
@group(1) @binding(2) var<storage, read> p: array<vec4f>;
@group(1) @binding(3) var<storage, read_write> statistics: Statistics;

// Histograms of one workgroup, which are added to the global ones at the end: all invocations would contend for the
// same few classes.
var<workgroup> stretches: array<atomic<u32>, CLASSES>;
var<workgroup> speeds: array<atomic<u32>, CLASSES>;
var<workgroup> sums: array<vec2f, WORKGROUP>;

@compute @workgroup_size(WORKGROUP)
fn count(me: Invocation, group: Workgroup) {
    for (var bin = me.lane; bin < CLASSES; bin += WORKGROUP) {
        atomicStore(&stretches[bin], 0u);
        atomicStore(&speeds[bin], 0u);
    }
    workgroupBarrier();
    var sum = vec2f(0.0);
    let all = group.all.x * group.all.y * WORKGROUP;
    var worst = 0.0;
    var crushed = 0u;
    for (var i = item(me.id, group.all); i < arrayLength(&gauges); i += all) {
        let gauge = gauges[i];
        let across = length(x[gauge.ends.x].xyz - x[gauge.ends.y].xyz);
        let stretched = stretch(across, gauge.inverse_rest);
        atomicAdd(&stretches[class_of(stretched, MIN_STRETCH)], gauge.weight);
        sum.x += f32(gauge.weight) * min(stretched, MAX_STRETCH);
        worst = max(worst, stretched);
        crushed += select(0u, gauge.weight, is_crushed(across, gauge.inverse_rest));
    }
    var fastest = 0.0;
    var low = vec3f(MAX_POSITION);
    var high = vec3f(-MAX_POSITION);
    for (var i = item(me.id, group.all); i < params.used; i += all) {
        low = min(low, x[i].xyz);
        high = max(high, x[i].xyz);
        if x[i].w > 0.0 {
            let speed = length(p[i].xyz - params.drift) / params.h;
            atomicAdd(&speeds[class_of(speed, MIN_SPEED)], 1u);
            sum.y += min(speed * speed, SLOW * SLOW);
            fastest = max(fastest, speed);
        }
    }
    atomicMax(&statistics.worst_stretch, bitcast<u32>(worst));
    atomicMax(&statistics.fastest, bitcast<u32>(fastest));
    if crushed > 0u { atomicAdd(&statistics.crushed, crushed); }
    for (var axis = 0u; axis < 3u; axis++) {
        atomicMin(&statistics.low[axis], ordered(low[axis]));
        atomicMax(&statistics.high[axis], ordered(high[axis]));
    }
    sums[me.lane] = sum;
    workgroupBarrier();
    for (var bin = me.lane; bin < CLASSES; bin += WORKGROUP) {
        let stretched = atomicLoad(&stretches[bin]);
        let fast = atomicLoad(&speeds[bin]);
        if stretched > 0u { atomicAdd(&statistics.stretch[bin], stretched); }
        if fast > 0u { atomicAdd(&statistics.speed[bin], fast); }
    }
    // A tree reduction, whose order of summation is always the same.
    for (var half = WORKGROUP / 2u; half > 0u; half /= 2u) {
        if me.lane < half { sums[me.lane] += sums[me.lane + half]; }
        workgroupBarrier();
    }
    if me.lane == 0u {
        atomicAdd(&statistics.mean_stretch, u32(sums[0].x * (ONE / f32(WHOLE)) + 0.5));
        atomicAdd(&statistics.slow, u32(sums[0].y * (SLOW_PARTS / (SLOW * SLOW)) + 0.5));
    }
}
