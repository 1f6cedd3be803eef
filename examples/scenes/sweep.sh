#!/usr/bin/env bash
# All variants of a sweep as a Slurm array, one variant per task: sbatch --array="1-$(drape --scene sweep.toml --list)" sweep.sh
# Finished variants are not run again, so an interrupted array can simply be submitted again.
#SBATCH --job-name=cloth-sweep
#SBATCH --cpus-per-task=2
#SBATCH --time=01:00:00
set -euo pipefail
export RAYON_NUM_THREADS="${SLURM_CPUS_PER_TASK:-2}"
exec "${DRAPE:-drape}" --scene "${SCENE:-sweep.toml}" --variant "$SLURM_ARRAY_TASK_ID" --out "${OUT:-sweep}"
