# The shipped models from nothing: 'make models' runs this with two jobs. Each target goes on where it was interrupted; delete one to make it anew.
B      := build/models
PYTHON := .venv-models/bin/python
OUT    := irsd/models/nano
TRAIN  := OMP_NUM_THREADS=1 ORT_DISABLE_TELEMETRY=1 $(PYTHON) -m training

.DELETE_ON_ERROR:
.PHONY: all
all: $(B)/pixels.done $(B)/points.done

# ---- pictures: the catalogue is read once, by the first of them
$(B)/held.done:
	mkdir -p $(B)
	$(TRAIN).render --seed 800000 --scenes 40 --out $(B)/held_pictures
	touch $@

$(B)/pictures_1.done: $(B)/held.done
	$(TRAIN).render --seed 0 --scenes 400 --out $(B)/pictures
	touch $@

$(B)/pictures_2.done: $(B)/held.done
	$(TRAIN).render --seed 400 --scenes 400 --out $(B)/pictures
	touch $@

$(B)/segmenter.done: $(B)/pictures_1.done $(B)/pictures_2.done
	$(TRAIN).train_segmenter --data $(B)/pictures --out $(B)/segmenter.pt --steps 14000
	touch $@

$(B)/image.done: $(B)/pictures_1.done $(B)/pictures_2.done
	$(TRAIN).train_image --data $(B)/pictures --val $(B)/held_pictures --out $(B)/image.pt --steps 8000
	touch $@

$(B)/pixels.done: $(B)/segmenter.done $(B)/image.done
	$(TRAIN).export_pixels --data $(B)/held_pictures --segmenter $(B)/segmenter.pt --image $(B)/image.pt --out $(OUT)
	$(TRAIN).fit_segmenter --val $(B)/held_pictures --model $(OUT)/segmenter.onnx
	touch $@

# ---- points; after the pictures, so that the longest chain begins first
$(B)/scenes.done: $(B)/pictures_1.done $(B)/pictures_2.done
	$(TRAIN).scene --seed 2 --count 140 --share 0 --out $(B)/scenes
	$(TRAIN).scene --seed 6 --count 360 --share 0.15 --out $(B)/scenes
	touch $@

$(B)/buildings.done: $(B)/scenes.done
	$(TRAIN).scene --seed 4 --count 300 --share 0.25 --out $(B)/buildings
	touch $@

$(B)/singles.npz: $(B)/scenes.done
	$(TRAIN).shape_data --count 8000 --seed 1 --out $@

$(B)/shape_rows.npz: $(B)/scenes.done $(B)/singles.npz
	$(TRAIN).shape_set --scenes $(B)/scenes --singles $(B)/singles.npz --variants 3 --out $@

$(B)/shape.done: $(B)/shape_rows.npz
	$(TRAIN).train_shape --data $(B)/shape_rows.npz --out $(B)/shape.pt --epochs 13 --export $(B)
	touch $@

$(B)/structure.done: $(B)/buildings.done
	$(TRAIN).train_structure --scenes $(B)/buildings --rows $(B)/structure_rows.npz --out $(B)/structure.pt --epochs 9 --export $(B)
	touch $@

$(B)/points.done: $(B)/shape.done $(B)/structure.done
	$(TRAIN).pack --float $(B) --shape-rows $(B)/shape_rows.npz --structure-rows $(B)/structure_rows.npz --out $(OUT)
	touch $@
