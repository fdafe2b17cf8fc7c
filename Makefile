# make demo   everything from nothing: .venv, both FMUs in dist/, the virtual rig, the result page
# make test   the tests, without the longest
# make test-long   the longest tests
# make reproduction, benchmark-rig, benchmark-estimator, benchmark-effects, benchmark-native, benchmark-scale, benchmark-diagnosis, benchmark-prediction-limit, benchmark-lab-data   the figures in docs/, measured again
# make lint   ruff and pyright
# make docs   the pages as a site in build/docs; the tutorial runs meanwhile; two minutes
# make benchmark-blind   docs/blind.md: the diagnosis on 620 sealed campaigns; hours, goes on where it was stopped
# make benchmark-real-rigs   docs/real-rigs.md: the same on 72 campaigns of three rotors that are known as a workshop knows them
# make native  the FMUs without Python inside, FMI 2.0 and 3.0, for five platforms, in dist/fmi2 and dist/fmi3
# make fmus, train   the FMUs alone; the estimator's network anew
# make benchmark-scaled-rigs   docs/scaled-rigs.md: the same rigs in other units have the same answers; half an hour
# make clean   without dist, build and runs
# make benchmark-real-data DATA=FOLDER   docs/real-data.md: the diagnosis on data of other laboratories; half an hour
# make benchmark-tracker   docs/tracker-measured.md: how well a k_b that changes is followed; minutes
# make benchmark-monitor   docs/monitor-measured.md: how well a change of the machine is found and named; ten minutes
# make benchmark-bias        docs/k-b-bias.md: what unknown effects do to k_b; five minutes
# make benchmark-hardening   docs/hardening-bearing.md: k_b and k_3 of a bearing that hardens; a quarter of an hour
# make benchmark-intervals   docs/interval-coverage.md: how often intervals of k_b hold the true value; half an hour
# make benchmark-records   k_b from an oscilloscope's records beside that of the sweep; minutes
# make importers   all FMUs as one system in ecos, libcosim, PathSim and a container, against fmpy; a minute
# make elsewhere   the binaries for Windows and ARM run here, by Wine and qemu (packages in tests/fmu/native/elsewhere.py)
# make fuzz    100,000 sequences of random FMI calls of each of them under sanitizers; an hour
# make fuzz-files   10,000 damaged files of every format are read: no traceback, no crash, no hang; an hour or two
# make kills   100 commands are killed at random moments: nothing is lost, half-written or left behind; half an hour
# make lowest   the lowest versions that pyproject.toml declares, installed together and tested; a quarter of an hour
# make method-figures   the figures of docs/diagnosis-method.md
# make paper-rig   docs/paper-rig.md: the diagnosis of the paper's own rig
# make laws   print the force laws anew, for Python and for C, after a change of rotor/model/force_laws.py
# make frozen-answers   the same answers as before? after a change that means to change none
# make thresholds   docs/thresholds.md, after a change of gap/verdict/thresholds.py
# make effect-pages   docs/effects anew, text and figures, after a change of rotor/effects
VENV := .venv
PYTHON3 ?= python3
# Draw of the report set that docs/blind.md shows. What has been learned from is no longer blind.
BLIND_SEED := 12
REAL_SEED := 13
PYTHON := $(VENV)/bin/python
# The matrices are small: one BLAS thread per process is several times faster than many.
export OPENBLAS_NUM_THREADS := 1
export OMP_NUM_THREADS := 1
export MKL_NUM_THREADS := 1

.PHONY: demo test test-long lint docs fmus native importers elsewhere fuzz fuzz-files kills lowest train reproduction benchmark-rig benchmark-estimator benchmark-effects benchmark-native benchmark-scale benchmark-diagnosis benchmark-prediction-limit benchmark-lab-data benchmark-real-data benchmark-records benchmark-bias benchmark-hardening benchmark-intervals benchmark-tracker benchmark-monitor benchmark-blind benchmark-real-rigs benchmark-scaled-rigs method-figures paper-rig laws frozen-answers thresholds effect-pages clean

demo: $(VENV)/installed
	$(PYTHON) -m rigtwin demo

test: $(VENV)/installed
	$(PYTHON) -m pytest -n 2 --dist loadfile -m "not long"

test-long: $(VENV)/installed
	$(PYTHON) -m pytest -n 2 --dist worksteal -m long

PACKAGES := rotor sim estimator fmu_src gap blind

lint: $(VENV)/installed
	mkdir -p build/lint/rigtwin
	for each in $(PACKAGES) $(wildcard rigtwin/*); do ln -sfn ../../../$$each build/lint/rigtwin/$$(basename $$each); done
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	$(VENV)/bin/pyright

# Packages of the site are installed when it is first built. A warning is an error.
docs: $(VENV)/installed-docs
	PATH="$(abspath $(VENV)/bin):$$PATH" $(VENV)/bin/sphinx-build -W --keep-going -q -b html -d build/doctrees docs build/docs
	@echo build/docs/index.html

fmus: $(VENV)/installed
	$(PYTHON) build_fmu.py

native: $(VENV)/installed
	$(PYTHON) build_fmu.py --native

importers: $(VENV)/installed
	$(PYTHON) -m tests.fmu.native.hosts

elsewhere: $(VENV)/installed
	$(PYTHON) -m tests.fmu.native.elsewhere

fuzz: $(VENV)/installed
	$(PYTHON) -m tests.fmu.native.sanitizers 100000

fuzz-files: $(VENV)/installed
	$(PYTHON) -m tests.fuzz_files --minutes 180

kills: $(VENV)/installed
	$(PYTHON) -m tests.kill_commands

lowest: $(VENV)/installed
	$(PYTHON) -m tests.lowest_versions

train: $(VENV)/installed
	$(PYTHON) -m rigtwin train

reproduction: $(VENV)/installed
	$(PYTHON) -m benchmarks.reproduction

benchmark-rig: $(VENV)/installed
	$(PYTHON) -m benchmarks.virtual_rig

benchmark-estimator: $(VENV)/installed
	$(PYTHON) -m benchmarks.estimator_accuracy

benchmark-effects: $(VENV)/installed
	$(PYTHON) -m benchmarks.effects

benchmark-native: $(VENV)/installed
	$(PYTHON) -m benchmarks.native

benchmark-scale: $(VENV)/installed
	$(PYTHON) -m benchmarks.scale

benchmark-diagnosis: $(VENV)/installed
	$(PYTHON) -m benchmarks.diagnosis_time

benchmark-prediction-limit: $(VENV)/installed
	$(PYTHON) -m benchmarks.prediction_limit

benchmark-lab-data: $(VENV)/installed
	$(PYTHON) -m benchmarks.lab_data

# DATA is a folder that holds the data sets; the command says which file is missing and where it comes from.
benchmark-real-data: $(VENV)/installed
	$(PYTHON) -m benchmarks.real_data $(DATA) --page docs/real-data.md

benchmark-tracker: $(VENV)/installed
	$(PYTHON) -m benchmarks.tracker --page docs/tracker-measured.md

benchmark-monitor: $(VENV)/installed
	$(PYTHON) -m benchmarks.monitor --page docs/monitor-measured.md

benchmark-bias: $(VENV)/installed
	$(PYTHON) -m benchmarks.k_b_bias --page docs/k-b-bias.md

benchmark-hardening: $(VENV)/installed
	$(PYTHON) -m benchmarks.cubic_bearing --page docs/hardening-bearing.md

benchmark-intervals: $(VENV)/installed
	$(PYTHON) -m benchmarks.interval_coverage --page docs/interval-coverage.md

benchmark-records: $(VENV)/installed
	$(PYTHON) -m benchmarks.oscilloscope_records

benchmark-blind: $(VENV)/installed
	$(VENV)/bin/rigtwin blind W1 --split report --seed $(BLIND_SEED) --count 200 --out runs/blind --page docs/blind.md
	$(VENV)/bin/rigtwin blind W2 W3 W4 W5 W6 W7 W8 --split report --seed $(BLIND_SEED) --count 60 --out runs/blind --page docs/blind.md

benchmark-real-rigs: $(VENV)/installed
	$(VENV)/bin/rigtwin blind W9 --split report --seed $(REAL_SEED) --count 72 --out runs/blind --page docs/real-rigs.md

benchmark-scaled-rigs: $(VENV)/installed
	$(PYTHON) -m benchmarks.scaled_rigs

method-figures: $(VENV)/installed
	$(PYTHON) -m benchmarks.method_figures

paper-rig: $(VENV)/installed
	$(PYTHON) -m benchmarks.paper_rig

laws: $(VENV)/installed
	$(PYTHON) build_laws.py

frozen-answers: $(VENV)/installed
	$(PYTHON) -m benchmarks.frozen_answers

thresholds: $(VENV)/installed
	$(PYTHON) -m benchmarks.thresholds

effect-pages: $(VENV)/installed
	$(PYTHON) -m benchmarks.effect_pages

clean:
	rm -rf dist build runs

$(VENV)/installed-docs: $(VENV)/installed
	$(VENV)/bin/python -m pip install --quiet -e '.[docs]'
	touch $@

$(VENV)/installed: pyproject.toml
	$(PYTHON3) -m venv $(VENV)
	$(VENV)/bin/python -m pip install --quiet --upgrade pip
	$(VENV)/bin/python -m pip install --quiet -e '.[train,native,dask,app,dev]'
	touch $@
