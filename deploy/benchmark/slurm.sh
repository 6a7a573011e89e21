#!/bin/bash
# One shard of a benchmark per task of a Slurm array: sbatch deploy/benchmark/slurm.sh SET.set.json POLICY...
# Preempted and lost tasks are queued again and go on with their folder; at most 8 of the 16 run at a time.
#SBATCH --job-name=dreamstream
#SBATCH --array=0-15%8
#SBATCH --cpus-per-task=2
#SBATCH --mem=4G
#SBATCH --time=04:00:00
#SBATCH --requeue
#SBATCH --signal=B:TERM@60
#SBATCH --output=%x-%A-%a.log
set -u
set_file=${1:?name a manifest, NAME.set.json}
shift
: "${1:?name at least one policy}"
out=${DREAMSTREAM_OUT:-out/benchmark}/$SLURM_ARRAY_TASK_ID
dreamstream=${DREAMSTREAM_BIN:-dreamstream}

# A folder that was begun is gone on with; --shard auto reads the task's variables.
if [ -e "$out/benchmark.json" ]; then
    set -- resume "$out"
else
    set -- run "$set_file" --policy "$@" --shard auto --workers "${SLURM_CPUS_PER_TASK:-1}" --out "$out"
fi
"$dreamstream" benchmark "$@" &
drive=$!
# Slurm signals this shell alone (B:), and kills all a minute later.
trap 'kill -TERM "$drive"' TERM
wait "$drive"
code=$?
# A signal ends the first wait; the drive then takes its time to drain.
if [ "$code" -gt 128 ] && kill -0 "$drive" 2>/dev/null; then
    wait "$drive"
    code=$?
fi
# 1: cells are left; 130: it was told to stop. Both go on where they were; 2 would fail again. What is left after six times
# would be left for ever.
if { [ "$code" -eq 1 ] || [ "$code" -eq 130 ]; } && [ "${SLURM_RESTART_COUNT:-0}" -lt 6 ]; then
    scontrol requeue "${SLURM_ARRAY_JOB_ID:-$SLURM_JOB_ID}_$SLURM_ARRAY_TASK_ID" || exit "$code"
fi
exit "$code"
